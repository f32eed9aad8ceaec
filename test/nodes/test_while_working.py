"""What a node answers while one of its callbacks takes long, and what waits for it: separate processes over DDS."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from live_graph import Graph, NodeProcess, image_message, values_of
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, GetParameterTypes, ListParameters, SetParameters
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.flight import Shot

NODE = "tracker_node"
LONG = 5  # steps of 10 ms: more than the 20 ms from which on a callback may have kept somebody waiting
PROGRAM = f"""
import sys
import time
from pathlib import Path

from stab_ros.nodes.runtime import run
from stab_ros.nodes.stopping import node_main
from stab_ros.nodes.tracker_node import TrackerNode

GATE, HELD = Path(sys.argv[1]), Path(sys.argv[2])


class Held(TrackerNode):
    # a tracker one of whose callbacks takes as long as there is a gate

    def poll(self):
        super().poll()
        while GATE.exists() and not self.stop.requested:
            with HELD.open("a") as marks:
                marks.write(".")
            time.sleep(0.01)


sys.exit(node_main("{NODE}", lambda stop: run(Held, stop)))
"""


LATE = """
import sys
import time

from stab_ros.nodes.runtime import run
from stab_ros.nodes.stopping import node_main
from stab_ros.nodes.tracker_node import TrackerNode


class Slow(TrackerNode):
    # one whose first step takes a moment
    COMPUTES = False  # nor is it shown an image

    def prepare(self):
        time.sleep(0.5)
        super().prepare()


def make():
    node = Slow()
    time.sleep(5.5)  # the program prepares something else
    return node


sys.exit(node_main("tracker_node", lambda stop: run(make, stop)))
"""


class HeldTracker:
    """A tracker of somebody's that can be held in the middle of a callback."""

    def __init__(self, graph: Graph, folder: Path, **parameters: object) -> None:
        self._graph, self._gate, self._held = graph, folder / "gate", folder / "held"
        self.answers: list[Any] = graph.listen(CameraInfo, "homography")
        arguments = [str(self._gate), str(self._held), "--ros-args"]
        for name, value in {"queue_depth": 0, "start_s": 0.0, "wait_for_subscribers": 1, **parameters}.items():
            arguments += ["-p", f"{name}:={value}"]
        self.process: NodeProcess = graph.run(NODE, arguments, ["-c", PROGRAM])
        self._images: Any = graph.speak(Image, "image_raw")

    def hold(self) -> None:
        self._gate.touch()
        self._graph.until(lambda: self._held.exists() and self._held.stat().st_size >= LONG, "the callback")

    def let_go(self) -> None:
        self._gate.unlink()

    def show(self, shots: list[Shot]) -> None:
        for shot in shots:
            self._images.publish(image_message(shot.image, shot.stamp_ns))

    def until_answered(self, count: int) -> None:
        self._graph.until(lambda: len(self.answers) >= count, f"{count} answers")

    def client(self, service: Any, name: str, harmless: Any) -> Any:
        """A client that has had an answer, to a request without effect: both sides know each other."""
        client = self._graph.node.create_client(service, f"{NODE}/{name}")
        self._graph.until(client.service_is_ready, name)
        self._graph.until(client.call_async(harmless).done, f"a first answer of {name}")
        return client

    def homography(self, number: int) -> FloatArray:
        return np.reshape(self.answers[number].r, (3, 3))


def threshold(value: float) -> SetParameters.Request:
    told = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
    return SetParameters.Request(parameters=[ParameterMessage(name="threshold", value=told)])


def transition(number: int) -> ChangeState.Request:
    return ChangeState.Request(transition=Transition(id=number))


def test_questions_and_the_reference_do_not_wait_for_a_frame(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    kept = tmp_path / "kept.mcap"
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    tracker = HeldTracker(graph, tmp_path, reference_path=kept, threshold=1.5)
    tracker.show(flight[:3])
    tracker.until_answered(3)
    graph.until(kept.exists, "the reference saved by itself")
    kept.unlink()
    setter = tracker.client(SetParameters, "set_parameters", SetParameters.Request())
    tracker.hold()
    tracker.show(flight[3:6])
    names = ["threshold"]
    shown = graph.call(GetParameters, f"{NODE}/get_parameters", GetParameters.Request(names=names))
    assert [one.double_value for one in shown.values] == [1.5]
    graph.call(GetParameterTypes, f"{NODE}/get_parameter_types", GetParameterTypes.Request(names=names))
    described = graph.call(DescribeParameters, f"{NODE}/describe_parameters", DescribeParameters.Request(names=names))
    assert described.descriptors[0].description
    listed = graph.call(ListParameters, f"{NODE}/list_parameters", ListParameters.Request())
    assert "threshold" in listed.result.names
    assert graph.call(GetState, f"{NODE}/get_state", GetState.Request()).current_state.label == "active"
    transitions = graph.call(GetAvailableTransitions, f"{NODE}/get_available_transitions",
                             GetAvailableTransitions.Request())
    assert "deactivate" in {one.transition.label for one in transitions.available_transitions}
    assert graph.call(Trigger, f"{NODE}/save_reference", Trigger.Request()).success
    assert kept.exists()
    assert graph.call(Trigger, f"{NODE}/reset_reference", Trigger.Request()).success
    after_reset = graph.call(Trigger, f"{NODE}/save_reference", Trigger.Request())
    assert not after_reset.success
    assert "there is no reference yet" in after_reset.message
    setting = setter.call_async(threshold(2.0))
    reports.clear()
    graph.until(lambda: any("at work on one step" in one.status[0].message for one in reports), "reports meanwhile")
    assert not setting.done()
    assert len(tracker.answers) == 3

    tracker.let_go()
    graph.until(setting.done, "the parameter set")
    assert setting.result().results[0].successful
    tracker.until_answered(6)
    np.testing.assert_array_equal(tracker.homography(3), np.eye(3))
    for number in (4, 5):  # to the fourth frame, as it was asked
        true = np.linalg.inv(flight[3].ref_H_cur) @ flight[number].ref_H_cur
        np.testing.assert_allclose(tracker.homography(number), true / true[2, 2], atol=0.1)
    graph.until(lambda: values_of(reports[-1])["frames_in"] == "6", "the report")
    assert values_of(reports[-1])["frames_dropped"] == "0"
    assert tracker.process.stop() == 0


def test_a_change_of_state_waits_for_one_callback_and_not_for_the_frames_that_wait(
    graph: Graph, flight: list[Shot], tmp_path: Path
) -> None:
    tracker = HeldTracker(graph, tmp_path)
    tracker.show(flight[:2])
    tracker.until_answered(2)
    change = tracker.client(ChangeState, "change_state", transition(Transition.TRANSITION_CONFIGURE))
    tracker.hold()
    tracker.show(flight[2:6])
    changing = change.call_async(transition(Transition.TRANSITION_DEACTIVATE))
    assert graph.call(GetState, f"{NODE}/get_state", GetState.Request()).current_state.label == "active"
    assert not changing.done()
    tracker.let_go()
    graph.until(changing.done, "the change")
    assert changing.result().success
    assert graph.call(GetState, f"{NODE}/get_state", GetState.Request()).current_state.label == "inactive"
    assert len(tracker.answers) == 2


@pytest.mark.thorough
def test_a_node_that_is_spun_late_was_not_at_work(graph: Graph) -> None:
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.run(NODE, ["--ros-args"], ["-c", LATE])
    graph.until(lambda: len(reports) >= 3, "reports")
    assert not any("at work" in one.status[0].message for one in reports)


@pytest.mark.thorough
def test_a_node_that_is_held_in_its_first_step_says_so(graph: Graph, tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    gate.touch()
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.run(NODE, [str(gate), str(tmp_path / "held"), "--ros-args"], ["-c", PROGRAM])
    graph.until(lambda: any("at work on one step" in one.status[0].message for one in reports), "a report")


def test_a_signal_in_the_middle_of_requests_ends_cleanly(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    tracker = HeldTracker(graph, tmp_path)
    tracker.show(flight[:2])
    tracker.until_answered(2)
    question = GetParameters.Request(names=["threshold"])
    setter = tracker.client(SetParameters, "set_parameters", SetParameters.Request())
    getter = tracker.client(GetParameters, "get_parameters", question)
    tracker.hold()
    waiting = [setter.call_async(threshold(2.0)) for _ in range(3)]
    for _ in range(5):
        getter.call_async(question)
    assert tracker.process.stop(signal.SIGINT) == 0
    assert "Traceback" not in tracker.process.log
    assert not all(one.done() for one in waiting)


def test_nobody_waits_in_the_process_of_a_user_with_several_threads(graph: Graph, tmp_path: Path) -> None:
    """As in one with a MultiThreadedExecutor, which knows the callback groups."""
    words = PROGRAM.partition("sys.exit")[0] + """
import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
rclpy.init()
executor = MultiThreadedExecutor(3)
executor.add_node(Held())
try:
    executor.spin()
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""
    gate, held = tmp_path / "gate", tmp_path / "held"
    gate.touch()
    process = graph.run(NODE, [str(gate), str(held), "--ros-args"], ["-c", words])
    graph.until(held.exists, "the callback")
    assert graph.call(GetState, f"{NODE}/get_state", GetState.Request()).current_state.label == "activating"
    graph.call(ListParameters, f"{NODE}/list_parameters", ListParameters.Request())
    gate.unlink()
    graph.until(lambda: graph.node.count_subscribers("image_raw"), "the tracker takes images")
    process.process.send_signal(signal.SIGINT)
    process.wait()
