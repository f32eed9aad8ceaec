"""Starts tracker and velocimetry, or other nodes, in one process on one camera: images come once for all of them.

ros2 launch stab_ros pipeline.launch.py namespace:=/camera config:=my.yaml [nodes:='[tracker, velocimetry, discharge]']
    [image:=/camera/image_raw] [fix:=/mavros/global_position/global] [imu:=/mavros/imu/data] [gimbal:=/gimbal/attitude]
    [water_level:=/gauge/level]
"""

from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from stab_ros.launch_arguments import (
    config_argument,
    given_lists,
    list_arguments,
    namespace_argument,
    remapped,
    topic_arguments,
)

_LISTS = {"nodes": "List of tracker, georeference, velocimetry, discharge and player, as [tracker, georeference]"}


def _pipeline(context):
    """The process, in the camera's namespace; nodes that were given take the place of those in `config`."""
    return [Node(
        package="stab_ros",
        executable="pipeline_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config"), *given_lists(context, _LISTS)],
        remappings=remapped(),
        output="screen",
    )]


def generate_launch_description() -> LaunchDescription:
    """One process with several nodes, in the camera's namespace."""
    return LaunchDescription([
        namespace_argument(),
        config_argument("config", "pipeline.yaml", "all nodes, with a section for each, as /**/tracker_node:"),
        *list_arguments(_LISTS, "; none: those of config"),
        *topic_arguments(),
        OpaqueFunction(function=_pipeline),
    ])
