"""Starts tracker and velocimetry on one camera.

ros2 launch stab_ros velocimetry.launch.py namespace:=/camera config:=my.yaml [image:=/camera/image_raw]
    [fix:=/mavros/global_position/global] [imu:=/mavros/imu/data] [gimbal:=/gimbal/attitude] [water_level:=/gauge/level]
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

_TOPICS = {"image": "image_raw", "camera_info": "camera_info", "fix": "fix", "imu": "imu", "gimbal": "gimbal",
           "water_level": "water_level"}


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
    velocimetry = Node(
        package="stab_ros",
        executable="velocimetry_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config")],
        remappings=[(topic, LaunchConfiguration(name)) for name, topic in _TOPICS.items()],
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
        tracker,
        velocimetry,
    ])
