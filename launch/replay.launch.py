"""A recorded flight through the live tracker into a new bag; every frame is answered.

ros2 launch stab_ros replay.launch.py bag:=flight.mcap output:=stabilized.mcap [namespace:=/camera] [rate:=1.0]
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Tracker, recorder and player, each waiting for the one after it."""
    namespace = LaunchConfiguration("namespace")
    tracker = Node(
        package="stab_ros",
        executable="tracker_node",
        namespace=namespace,
        parameters=[{"queue_depth": 0, "wait_for_subscribers": 1}],
        output="screen",
    )
    recorder = Node(
        package="stab_ros",
        executable="bag_recorder_node",
        namespace=namespace,
        parameters=[{
            "output": LaunchConfiguration("output"),
            "topics": ["homography", "image_stabilized", "tracker_node/track"],
        }],
        output="screen",
    )
    player = Node(
        package="stab_ros",
        executable="bag_player_node",
        parameters=[{
            "bag": LaunchConfiguration("bag"),
            "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
            "wait_for_subscribers": 1,
        }],
        output="screen",
    )
    return LaunchDescription([
        DeclareLaunchArgument("bag", description="the recording: an .mcap, a rosbag2 folder or a ROS 1 .bag"),
        DeclareLaunchArgument("output", description="the .mcap to write; end with Ctrl-C once all frames are answered"),
        DeclareLaunchArgument("namespace", default_value="/camera", description="of the recorded camera"),
        DeclareLaunchArgument("rate", default_value="1.0", description="times real time"),
        tracker,
        recorder,
        player,
    ])
