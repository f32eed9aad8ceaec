"""Starts tracker and velocimetry, or other nodes, in one process on one camera: images come once for all of them.

ros2 launch stab_ros pipeline.launch.py namespace:=/camera config:=my.yaml [nodes:='[tracker, velocimetry, discharge]']
    [image:=/camera/image_raw] [fix:=/mavros/global_position/global] [imu:=/mavros/imu/data] [gimbal:=/gimbal/attitude]
    [water_level:=/gauge/level]
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

_TOPICS = {"image": "image_raw", "camera_info": "camera_info", "fix": "fix", "imu": "imu", "gimbal": "gimbal",
           "water_level": "water_level"}


def _pipeline(context):
    """The process, in the camera's namespace; nodes that were given take the place of those in `config`."""
    nodes = LaunchConfiguration("nodes").perform(context)
    chosen = [{"nodes": ParameterValue(nodes, value_type=str)}] if nodes else []
    return [Node(
        package="stab_ros",
        executable="pipeline_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config"), *chosen],
        remappings=[(topic, LaunchConfiguration(name)) for name, topic in _TOPICS.items()],
        output="screen",
    )]


def generate_launch_description() -> LaunchDescription:
    """One process with several nodes, in the camera's namespace."""
    config = PathJoinSubstitution([FindPackageShare("stab_ros"), "config", "pipeline.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="/camera", description="Namespace of the camera"),
        DeclareLaunchArgument("config", default_value=config,
                              description="Parameter file, with a section for each node, as /**/tracker_node:"),
        DeclareLaunchArgument("nodes", default_value="", description="List of tracker, georeference, velocimetry, "
                              "discharge and player, as [tracker, georeference]; none: those of config"),
        *(DeclareLaunchArgument(name, default_value=topic, description=f"Topic in place of {topic}")
          for name, topic in _TOPICS.items()),
        OpaqueFunction(function=_pipeline),
    ])
