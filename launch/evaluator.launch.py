"""Starts the evaluator on the stabilised stream of one camera.

ros2 launch stab_ros evaluator.launch.py namespace:=/camera [config:=my.yaml] [image:=/camera/image_stabilized]
    [exclude:='[[[0,130],[960,150],[960,420],[0,410]]]'] [roi:=bank.json]
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from stab_ros.launch_arguments import config_argument, given_lists, list_arguments, namespace_argument

_REGIONS = {"roi": "Region to measure in", "exclude": "Region to ignore, for example the water"}
_FORMS = ": [[[x, y], ...], ...] in reference pixels, a .json or a PNG mask; none: that of config"


def _evaluator(context):
    """The node, in the camera's namespace; regions that were given take the place of those in `config`."""
    return [Node(
        package="stab_ros",
        executable="evaluator_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config"), *given_lists(context, _REGIONS)],
        remappings=[("image_stabilized", LaunchConfiguration("image"))],
        output="screen",
    )]


def generate_launch_description() -> LaunchDescription:
    """One node, in the camera's namespace."""
    return LaunchDescription([
        namespace_argument(),
        DeclareLaunchArgument("image", default_value="image_stabilized", description="Topic of the stabilised images"),
        config_argument("config", "evaluator.yaml", "the evaluator"),
        *list_arguments(_REGIONS, _FORMS),
        OpaqueFunction(function=_evaluator),
    ])
