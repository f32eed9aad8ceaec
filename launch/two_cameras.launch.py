"""Starts a tracker for each of two cameras.

ros2 launch stab_ros two_cameras.launch.py first:=/left second:=/right
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """`tracker.launch.py` twice."""
    tracker = PathJoinSubstitution([FindPackageShare("stab_ros"), "launch", "tracker.launch.py"])
    return LaunchDescription([
        DeclareLaunchArgument("first", default_value="/left", description="Namespace of the first camera"),
        DeclareLaunchArgument("second", default_value="/right", description="Namespace of the second camera"),
        *(
            IncludeLaunchDescription(tracker, launch_arguments={"namespace": LaunchConfiguration(name)}.items())
            for name in ("first", "second")
        ),
    ])
