"""Starts tracker and velocimetry on one camera.

ros2 launch stab_ros velocimetry.launch.py namespace:=/camera config:=my.yaml [image:=/camera/image_raw]
    [fix:=/mavros/global_position/global] [imu:=/mavros/imu/data] [gimbal:=/gimbal/attitude] [water_level:=/gauge/level]
    [roi:='[[[0,130],[960,150],[960,420],[0,410]]]'] [exclude:=bridge.json] [lines:='[[[0,0],[10.5,2]]]']
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

_TOPICS = {"image": "image_raw", "camera_info": "camera_info", "fix": "fix", "imu": "imu", "gimbal": "gimbal",
           "water_level": "water_level"}

_LISTS = {"roi": "Region in which velocities are wanted: [[[x, y], ...], ...] in reference pixels, a .json or a mask",
          "exclude": "Region to leave out: the same", "lines": "Lines of stiv: [[[x, y], [x, y]], ...] or a .json"}


def _velocimetry(context):
    """The node, in the camera's namespace; lists that were given take the place of those in `config`."""
    given = {name: LaunchConfiguration(name).perform(context) for name in _LISTS}
    lists = {name: ParameterValue(text, value_type=str) for name, text in given.items() if text}
    return [Node(
        package="stab_ros",
        executable="velocimetry_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config"), *([lists] if lists else [])],
        remappings=[(topic, LaunchConfiguration(name)) for name, topic in _TOPICS.items()],
        output="screen",
    )]


def generate_launch_description() -> LaunchDescription:
    """Two nodes, in the camera's namespace: the homographies of the first one go to the second."""
    config = PathJoinSubstitution([FindPackageShare("stab_ros"), "config", "velocimetry.yaml"])
    tracker = Node(
        package="stab_ros",
        executable="tracker_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[{"use_camera_info": True}, LaunchConfiguration("tracker_config")],
        remappings=[(_TOPICS[name], LaunchConfiguration(name)) for name in ("image", "camera_info")],
        output="screen",
    )
    tracker_config = PathJoinSubstitution([FindPackageShare("stab_ros"), "config", "tracker.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="/camera", description="Namespace of the camera"),
        DeclareLaunchArgument("config", default_value=config, description="Parameter file of velocimetry"),
        DeclareLaunchArgument("tracker_config", default_value=tracker_config,
                              description="Parameter file of the tracker"),
        *(DeclareLaunchArgument(name, default_value=topic, description=f"Topic in place of {topic}")
          for name, topic in _TOPICS.items()),
        *(DeclareLaunchArgument(name, default_value="", description=f"{meaning}; none: those of config")
          for name, meaning in _LISTS.items()),
        tracker,
        OpaqueFunction(function=_velocimetry),
    ])
