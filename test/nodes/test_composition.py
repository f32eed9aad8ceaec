"""Our nodes in a process of somebody else: own context, name, namespace and parameters, in any executor of rclpy."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from image_publisher import FRAMES, by_the_engine, shots
from launch_files import ROOT
from live_graph import Graph, image_message
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.nodes.tracker_node import TrackerNode

PROGRAM = """
import sys

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo

from stab_ros.nodes.evaluator_node import EvaluatorNode
from stab_ros.nodes.tracker_node import TrackerNode

context = Context()
rclpy.init(context=context, args=["--ros-args", "-r", "__node:=renamed", "-p", "method:=klt"])  # for nodes that ask
ours = {"context": context, "namespace": "/cam", "use_global_arguments": False}
if sys.argv[1] == "evaluator":
    nodes = [EvaluatorNode(**ours)]
else:
    overrides = [Parameter("queue_depth", value=0), Parameter("wait_for_subscribers", value=2)]
    own = Node("own", context=context, namespace="/cam", use_global_arguments=False)
    again = own.create_publisher(CameraInfo, "again", 500)
    own.create_subscription(CameraInfo, "homography", again.publish, 500)
    nodes = [TrackerNode(node_name="steady", parameter_overrides=overrides, **ours), own]
executor = (MultiThreadedExecutor(3, context=context) if sys.argv[1] == "multi" else
            SingleThreadedExecutor(context=context))
for node in nodes:
    executor.add_node(node)
try:
    executor.spin()
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


@contextmanager
def program(graph: Graph, kind: str, log: Path) -> Iterator[None]:
    """The program as a process on the graph, with its stderr in `log`."""
    with log.open("w") as errors, subprocess.Popen(
            [sys.executable, "-c", PROGRAM, kind], env=graph.environment, stderr=errors) as process:
        try:
            yield
        finally:
            process.send_signal(signal.SIGINT)
    assert "Traceback" not in log.read_text()


@pytest.mark.parametrize("kind", ["single", "multi"])
def test_the_tracker_beside_a_node_of_somebody_else_answers_as_the_engine(
        graph: Graph, kind: str, tmp_path: Path) -> None:
    answers: list[Any] = graph.listen(CameraInfo, "/cam/homography", 500)
    again: list[Any] = graph.listen(CameraInfo, "/cam/again", 500)
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    with program(graph, kind, tmp_path / "log"):
        images = graph.speak(Image, "/cam/image_raw", 300)
        for shot in shots():
            images.publish(image_message(shot.image, shot.stamp_ns))
        graph.until(lambda: len(answers) == len(again) == FRAMES, "every frame answered, and heard by the other node")
        graph.until(lambda: reports, "a report")
    assert {report.status[0].name for report in reports} == {"cam/steady"}
    assert answers == again
    for answer, H in zip(answers, by_the_engine(), strict=True):
        np.testing.assert_allclose(np.reshape(answer.r, (3, 3)), H, rtol=0, atol=1e-9)


def test_a_node_that_needs_a_process_of_its_own_says_so(graph: Graph, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with program(graph, "evaluator", log):
        graph.until(lambda: "start its executable instead" in log.read_text(), "the advice")
    assert log.read_text().count("start its executable instead") == 1


@pytest.mark.thorough
def test_a_tracker_leaves_a_running_executor_as_the_page_says(graph: Graph) -> None:
    """With frames under way on several threads; nothing of it is left in the graph, and the others go on."""
    (code,) = re.findall(r"```python\n( +def remove\(.*?)```", (ROOT / "docs" / "ros.md").read_text(), re.DOTALL)
    program: dict[str, Any] = {"threading": threading}
    exec(textwrap.dedent(code), program)
    executor, own = MultiThreadedExecutor(3, context=graph.context), Node("own", context=graph.context)
    answers: list[Any] = []
    own.create_subscription(CameraInfo, "homography", answers.append, 100)
    images = own.create_publisher(Image, "image_raw", 100)
    executor.add_node(own)

    def spin_until(condition: Callable[[], bool]) -> None:
        while not condition():
            executor.spin_once(timeout_sec=0.1)

    for number in range(5):
        tracker = TrackerNode(context=graph.context, node_name=f"tracker_{number}", use_global_arguments=False,
                              parameter_overrides=[Parameter("start_s", value=0.0), Parameter("queue_depth", value=0)])
        executor.add_node(tracker)
        spin_until(lambda: images.get_subscription_count() == 1)
        for shot in shots():
            images.publish(image_message(shot.image, shot.stamp_ns))
        answers.clear()
        spin_until(lambda: len(answers) > 2)
        program["remove"](executor, tracker, 3)
        spin_until(lambda: images.get_subscription_count() == 0)
        assert f"tracker_{number}" not in own.get_node_names()
    executor.shutdown()
    own.destroy_node()
