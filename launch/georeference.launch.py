"""Starts tracker and georeferencing on one camera.

ros2 launch stab_ros georeference.launch.py namespace:=/camera config:=my.yaml [image:=/camera/image_raw]
    [fix:=/mavros/global_position/global] [imu:=/mavros/imu/data] [gimbal:=/gimbal/attitude] [water_level:=/gauge/level]
"""

from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from stab_ros.launch_arguments import calibrated_tracker, config_argument, namespace_argument, remapped, topic_arguments


def generate_launch_description() -> LaunchDescription:
    """Two nodes, in the camera's namespace: the homographies of the first one go to the second."""
    georeference = Node(
        package="stab_ros",
        executable="georeference_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config")],
        remappings=remapped(),
        output="screen",
    )
    return LaunchDescription([
        namespace_argument(),
        config_argument("config", "georeference.yaml", "georeferencing"),
        config_argument("tracker_config", "tracker.yaml", "the tracker"),
        *topic_arguments(),
        calibrated_tracker(),
        georeference,
    ])
