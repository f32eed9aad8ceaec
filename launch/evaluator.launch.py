"""Starts the evaluator on the stabilised stream of one camera.

ros2 launch stab_ros evaluator.launch.py namespace:=/camera [config:=my.yaml] [image:=/camera/image_stabilized]
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """One node, in the camera's namespace."""
    config = PathJoinSubstitution([FindPackageShare("stab_ros"), "config", "evaluator.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="/camera", description="Namespace of the camera"),
        DeclareLaunchArgument("image", default_value="image_stabilized", description="Topic of the stabilised images"),
        DeclareLaunchArgument("config", default_value=config, description="Parameter file of the evaluator"),
        Node(
            package="stab_ros",
            executable="evaluator_node",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("config")],
            remappings=[("image_stabilized", LaunchConfiguration("image"))],
            output="screen",
        ),
    ])
