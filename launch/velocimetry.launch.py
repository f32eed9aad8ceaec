"""Starts tracker and velocimetry on one camera.

ros2 launch stab_ros velocimetry.launch.py namespace:=/camera config:=my.yaml [image:=/camera/image_raw]
    [fix:=/mavros/global_position/global] [imu:=/mavros/imu/data] [gimbal:=/gimbal/attitude] [water_level:=/gauge/level]
    [roi:='[[[0,130],[960,150],[960,420],[0,410]]]'] [exclude:=bridge.json] [lines:='[[[0,0],[10.5,2]]]']
"""

from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from stab_ros.launch_arguments import (
    calibrated_tracker,
    config_argument,
    given_lists,
    list_arguments,
    namespace_argument,
    remapped,
    topic_arguments,
)

_LISTS = {"roi": "Region in which velocities are wanted: [[[x, y], ...], ...] in reference pixels, a .json or a mask",
          "exclude": "Region to leave out: the same", "lines": "Lines of stiv: [[[x, y], [x, y]], ...] or a .json"}


def _velocimetry(context):
    """The node, in the camera's namespace; lists that were given take the place of those in `config`."""
    return [Node(
        package="stab_ros",
        executable="velocimetry_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config"), *given_lists(context, _LISTS)],
        remappings=remapped(),
        output="screen",
    )]


def generate_launch_description() -> LaunchDescription:
    """Two nodes, in the camera's namespace: the homographies of the first one go to the second."""
    return LaunchDescription([
        namespace_argument(),
        config_argument("config", "velocimetry.yaml", "velocimetry"),
        config_argument("tracker_config", "tracker.yaml", "the tracker"),
        *topic_arguments(),
        *list_arguments(_LISTS, "; none: those of config"),
        calibrated_tracker(),
        OpaqueFunction(function=_velocimetry),
    ])
