"""Starts tracker, velocimetry and discharge on one camera.

ros2 launch stab_ros discharge.launch.py section:=section.csv namespace:=/camera config:=my_velocimetry.yaml
    [discharge_config:=my.yaml] [image:=/camera/image_raw] [fix:=/mavros/global_position/global] [imu:=/mavros/imu/data]
    [gimbal:=/gimbal/attitude] [water_level:=/gauge/level]
    [roi:='[[[0,130],[960,150],[960,420],[0,410]]]'] [exclude:=bridge.json] [lines:='[[[0,0],[10.5,2]]]']
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from stab_ros.launch_arguments import (
    TOPICS,
    config_argument,
    list_arguments,
    namespace_argument,
    remapped,
    topic_arguments,
)

# an included file sets its arguments in the file that includes it, so that they have the same names in both
_LISTS = {"roi": "Region in which velocities are wanted", "exclude": "Region to leave out", "lines": "Lines of stiv"}
_OF_VELOCIMETRY = ("namespace", "config", "tracker_config", *TOPICS, *_LISTS)


def generate_launch_description() -> LaunchDescription:
    """`velocimetry.launch.py`, and a third node in the same namespace that takes its velocities."""
    velocimetry = IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare("stab_ros"), "launch", "velocimetry.launch.py"]),
        launch_arguments={name: LaunchConfiguration(name) for name in _OF_VELOCIMETRY}.items(),
    )
    discharge = Node(
        package="stab_ros",
        executable="discharge_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("discharge_config"),
            {"section_file": ParameterValue(LaunchConfiguration("section"), value_type=str)},
        ],
        remappings=remapped(("water_level",)),
        output="screen",
    )
    return LaunchDescription([
        DeclareLaunchArgument("section", description="Cross-section: X,Y,Z or X,Y,depth in the map"),
        namespace_argument(),
        config_argument("config", "velocimetry.yaml", "velocimetry"),
        config_argument("discharge_config", "discharge.yaml", "discharge"),
        config_argument("tracker_config", "tracker.yaml", "the tracker"),
        *topic_arguments(),
        *list_arguments(_LISTS, ", as in velocimetry.launch.py"),
        velocimetry,
        discharge,
    ])
