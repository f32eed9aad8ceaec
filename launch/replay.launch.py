"""Plays a recorded flight through the live tracker and the evaluator into a new bag; every frame is tracked.

ros2 launch stab_ros replay.launch.py bag:=flight.mcap output:=stabilized.mcap [namespace:=/camera] [rate:=1.0]
    [evaluate:=true]
"""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Tracker, evaluator, recorder and player; tracker and player wait for their subscribers."""
    namespace = LaunchConfiguration("namespace")
    evaluate = LaunchConfiguration("evaluate")
    subscribers = PythonExpression(["2 if '", evaluate, "'.lower() in ('true', '1') else 1"])
    tracker = Node(
        package="stab_ros",
        executable="tracker_node",
        namespace=namespace,
        parameters=[{"queue_depth": 0, "wait_for_subscribers": ParameterValue(subscribers, value_type=int)}],
        output="screen",
    )
    evaluator = Node(
        package="stab_ros",
        executable="evaluator_node",
        namespace=namespace,
        condition=IfCondition(evaluate),
        parameters=[{"wait_for_subscribers": 1}],
        output="screen",
    )
    recorder = Node(
        package="stab_ros",
        executable="bag_recorder_node",
        namespace=namespace,
        parameters=[{
            "output": LaunchConfiguration("output"),
            "topics": ["homography", "image_stabilized", "tracker_node/track", "evaluator_node/metrics"],
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
        DeclareLaunchArgument("bag", description="Recording: an .mcap, a rosbag2 folder or a ROS 1 .bag"),
        DeclareLaunchArgument("output", description="The .mcap to write; end with Ctrl-C once all frames are tracked"),
        DeclareLaunchArgument("namespace", default_value="/camera", description="Namespace of the recorded camera"),
        DeclareLaunchArgument("rate", default_value="1.0", description="Playback speed relative to real time"),
        DeclareLaunchArgument("evaluate", default_value="true", description="Whether to start the evaluator"),
        tracker,
        evaluator,
        recorder,
        player,
    ])
