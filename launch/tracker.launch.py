"""Starts the tracker on one camera.

ros2 launch stab_ros tracker.launch.py namespace:=/camera [config:=my.yaml] [image:=/camera/image_raw]
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """One node, in the camera's namespace."""
    config = PathJoinSubstitution([FindPackageShare("stab_ros"), "config", "tracker.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="/camera", description="Namespace of the camera"),
        DeclareLaunchArgument("image", default_value="image_raw", description="Image topic of the camera"),
        DeclareLaunchArgument("config", default_value=config, description="Parameter file of the tracker"),
        Node(
            package="stab_ros",
            executable="tracker_node",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("config")],
            remappings=[("image_raw", LaunchConfiguration("image"))],
            output="screen",
        ),
    ])
