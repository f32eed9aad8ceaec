"""Starts the tracker on one camera.

ros2 launch stab_ros tracker.launch.py namespace:=/camera [config:=my.yaml] [image:=/camera/image_raw]
    [exclude:='[[[0,130],[960,150],[960,420],[0,410]]]'] [roi:=bank.json]
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from stab_ros.launch_arguments import config_argument, given_lists, list_arguments, namespace_argument

_REGIONS = {"roi": "Region of static ground", "exclude": "Region to ignore, for example the water"}
_FORMS = ": [[[x, y], ...], ...] in reference pixels, a .json or a PNG mask; none: that of config"


def _tracker(context):
    """The node, in the camera's namespace; regions that were given take the place of those in `config`."""
    return [Node(
        package="stab_ros",
        executable="tracker_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config"), *given_lists(context, _REGIONS)],
        remappings=[("image_raw", LaunchConfiguration("image"))],
        output="screen",
    )]


def generate_launch_description() -> LaunchDescription:
    """One node, in the camera's namespace."""
    return LaunchDescription([
        namespace_argument(),
        DeclareLaunchArgument("image", default_value="image_raw", description="Image topic of the camera"),
        config_argument("config", "tracker.yaml", "the tracker"),
        *list_arguments(_REGIONS, _FORMS),
        OpaqueFunction(function=_tracker),
    ])
