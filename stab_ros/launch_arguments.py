"""What the launch files of this package have in common; it needs ROS's launch and launch_ros."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext

# of camera and sensors, by the name of the argument
TOPICS: Mapping[str, str] = {"image": "image_raw", "camera_info": "camera_info", "fix": "fix", "imu": "imu",
                             "gimbal": "gimbal", "water_level": "water_level"}


def namespace_argument() -> DeclareLaunchArgument:
    """Where the nodes of a camera are."""
    return DeclareLaunchArgument("namespace", default_value="/camera", description="Namespace of the camera")


def config_argument(name: str, file: str, of: str) -> DeclareLaunchArgument:
    """A parameter file, by default the one of that name in `config`. of: whose parameters it holds."""
    default = PathJoinSubstitution([FindPackageShare("stab_ros"), "config", file])
    return DeclareLaunchArgument(name, default_value=default, description=f"Parameter file of {of}")


def topic_arguments() -> list[DeclareLaunchArgument]:
    """One for each of TOPICS."""
    return [DeclareLaunchArgument(name, default_value=topic, description=f"Topic in place of {topic}")
            for name, topic in TOPICS.items()]


def remapped(names: Iterable[str] = TOPICS) -> list[tuple[str, LaunchConfiguration]]:
    """The remappings of these topic arguments."""
    return [(TOPICS[name], LaunchConfiguration(name)) for name in names]


def list_arguments(meanings: Mapping[str, str], forms: str) -> list[DeclareLaunchArgument]:
    """Arguments that are lists of lists, as polygons, or files. forms: how all of them are written."""
    return [DeclareLaunchArgument(name, default_value="", description=f"{meaning}{forms}")
            for name, meaning in meanings.items()]


def given_lists(context: LaunchContext, names: Iterable[str]) -> list[dict[str, ParameterValue]]:
    """The parameters of those that were given, as text; the others are left to the parameter file."""
    given = {name: LaunchConfiguration(name).perform(context) for name in names}
    lists = {name: ParameterValue(text, value_type=str) for name, text in given.items() if text}
    return [lists] if lists else []


def calibrated_tracker() -> Node:
    """The tracker before a node that works in metres: it takes the camera's calibration into account."""
    return Node(
        package="stab_ros",
        executable="tracker_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[{"use_camera_info": True}, LaunchConfiguration("tracker_config")],
        remappings=remapped(("image", "camera_info")),
        output="screen",
    )
