"""Starts the evaluator on the stabilised stream of one camera.

ros2 launch stab_ros evaluator.launch.py namespace:=/camera [config:=my.yaml] [image:=/camera/image_stabilized]
    [exclude:='[[[0,130],[960,150],[960,420],[0,410]]]'] [roi:=bank.json]
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

_REGIONS = {"roi": "Region to measure in", "exclude": "Region to ignore, for example the water"}
_FORMS = "[[[x, y], ...], ...] in reference pixels, a .json or a PNG mask; none: that of config"


def _evaluator(context):
    """The node, in the camera's namespace; regions that were given take the place of those in `config`."""
    given = {name: LaunchConfiguration(name).perform(context) for name in _REGIONS}
    regions = {name: ParameterValue(text, value_type=str) for name, text in given.items() if text}
    return [Node(
        package="stab_ros",
        executable="evaluator_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("config"), *([regions] if regions else [])],
        remappings=[("image_stabilized", LaunchConfiguration("image"))],
        output="screen",
    )]


def generate_launch_description() -> LaunchDescription:
    """One node, in the camera's namespace."""
    config = PathJoinSubstitution([FindPackageShare("stab_ros"), "config", "evaluator.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="/camera", description="Namespace of the camera"),
        DeclareLaunchArgument("image", default_value="image_stabilized", description="Topic of the stabilised images"),
        DeclareLaunchArgument("config", default_value=config, description="Parameter file of the evaluator"),
        *(DeclareLaunchArgument(name, default_value="", description=f"{meaning}: {_FORMS}")
          for name, meaning in _REGIONS.items()),
        OpaqueFunction(function=_evaluator),
    ])
