"""Streams that begin late, lack homographies, are bright, broken or undistorted, as the evaluator node sees them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, NodeProcess, image_message, values_of
from live_stream import StabilizedStream, still
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image
from truth import IDENTITY, frame, picture, translation

from stab_ros.core.types import Gray
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.settings import EvaluatorConfig

METRICS = "/cam/evaluator_node/metrics"
REFERENCE = "/cam/tracker_node/reference_image"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SIZE = (400, 300)


@pytest.fixture(scope="module")
def ground() -> Gray:
    """An image with a margin, from which `still` crops one."""
    return picture(IDENTITY, (SIZE[0] + 16, SIZE[1] + 16), noise=0)


def listening(graph: Graph, **parameters: Any) -> tuple[NodeProcess, list[Any], list[Any]]:
    """The node, and what it says on `~/metrics` and on /diagnostics; our streams may pause without being STALE."""
    heard = graph.listen(DiagnosticArray, METRICS), graph.listen(DiagnosticArray, "/diagnostics")
    parameters = {"stale_s": 1000.0, "wait_for_subscribers": 1, **parameters}
    return graph.start("evaluator_node", "/cam", **parameters), *heard


def said(diagnostics: list[Any], text: str) -> bool:
    return any(text in message.status[0].message for message in diagnostics)


def test_images_of_another_tool_need_no_homographies(graph: Graph, ground: Gray) -> None:
    _, metrics, _ = listening(graph, rmse_every=1)
    stream = StabilizedStream(graph, ground, homographies=False)
    stream.send(3)
    stream.send(shift_px=2)
    graph.until(lambda: len(metrics) == 4, "every image measured")
    values = [values_of(one) for one in metrics]
    assert [one["outcome"] for one in values] == ["REFERENCE", "MEASURED", "MEASURED", "MEASURED"]
    assert float(values[2]["displacement_reference_px"]) < 0.1
    assert float(values[3]["displacement_reference_px"]) == pytest.approx(2, abs=0.3)
    assert float(values[3]["rmse_reference_px"]) == pytest.approx(2, abs=0.1)
    assert float(values[3]["shift_u_px"]) == pytest.approx(2, abs=0.05)


def test_an_evaluator_that_joins_late_measures_against_the_reference_of_the_tracker(graph: Graph, ground: Gray) -> None:
    """All images it receives are 2 px off, which shows only against the latched reference."""
    reference = graph.node.create_publisher(Image, REFERENCE, LATCHED)
    first = still(ground, 0)
    reference.publish(image_message(first, 10**9))
    _, metrics, _ = listening(graph)
    stream = StabilizedStream(graph, ground)
    stream.number = 50
    stream.send(4, shift_px=2)
    graph.until(lambda: len(metrics) == 4, "every image measured")
    by_hand = Evaluator(EvaluatorConfig())
    by_hand.use_reference(frame(first))
    for index, message in enumerate(metrics):
        values, shot = values_of(message), frame(still(ground, 50 + index, 2), 50 + index)
        expected = by_hand.step(Arrival(index, shot.stamp_ns, IDENTITY, False, shot))
        assert values["outcome"] == "MEASURED"
        assert float(values["displacement_reference_px"]) == pytest.approx(
            expected["displacement_reference_px"], abs=1e-9)
    assert float(values_of(metrics[0])["displacement_reference_px"]) == pytest.approx(2, abs=0.3)


def test_a_new_reference_restarts_the_comparison(graph: Graph, ground: Gray) -> None:
    _, metrics, _ = listening(graph)
    references = graph.speak(Image, REFERENCE, LATCHED)
    stream = StabilizedStream(graph, ground)
    stream.send(2)
    graph.until(lambda: len(metrics) == 2, "two images measured")
    references.publish(image_message(still(ground, stream.number, 3), 10**9 + stream.number * 40_000_000))
    stream.send(3, shift_px=3)
    graph.until(lambda: len(metrics) == 5, "every image measured")
    values = [values_of(one) for one in metrics]
    assert [one["outcome"] for one in values] == ["REFERENCE", "MEASURED", "REFERENCE", "MEASURED", "MEASURED"]
    assert float(values[4]["displacement_reference_px"]) < 0.1


@pytest.mark.thorough
def test_a_change_of_brightness_is_reported_and_no_motion(graph: Graph, ground: Gray) -> None:
    _, metrics, diagnostics = listening(graph)
    stream = StabilizedStream(graph, ground)
    stream.send(2)
    bright = np.clip(np.round(1.05 * still(ground, 2)), 0, 255).astype(np.uint8)
    stream.send(shown=bright)
    graph.until(lambda: said(diagnostics, "brightness changed by +") and len(metrics) > 2, "the warning")
    values = values_of(metrics[2])
    assert float(values["brightness_change"]) == pytest.approx(0.05, abs=0.01)
    assert float(values["displacement_reference_px"]) < 0.1 < float(values["rmsd_reference"])
    assert {message.status[0].level for message in diagnostics} <= {b"\x00", b"\x01"}
    assert not said(diagnostics, "displaced")


def test_a_damaged_image_is_refused_and_reported(graph: Graph, ground: Gray) -> None:
    evaluator, metrics, diagnostics = listening(graph)
    stream = StabilizedStream(graph, ground, homographies=False)
    stream.send(2)
    broken = graph.speak(Image, "/cam/image_stabilized")
    broken.publish(image_message(still(ground, 2), 10**9 + 2 * 40_000_000, step=7))
    graph.until(lambda: said(diagnostics, "refused a message: /cam/image_stabilized"), "the warning")
    stream.number = 3
    stream.send(2)
    graph.until(lambda: len(metrics) == 4, "the others measured")
    graph.until(lambda: diagnostics and values_of(diagnostics[-1])["frames_refused"] == "1", "the refusal counted")
    assert evaluator.stop() == 0


def test_metres_and_thresholds_change_in_flight(graph: Graph, ground: Gray) -> None:
    _, metrics, diagnostics = listening(graph, gsd_m=0.02, fps=25.0, alarm_s=1000.0)
    stream = StabilizedStream(graph, ground)
    stream.send(1)
    stream.send(1, shift_px=1)
    graph.until(lambda: len(metrics) == 2, "two images measured")
    values = values_of(metrics[1])
    moved_px = float(values["displacement_previous_px"])
    assert moved_px == pytest.approx(1, abs=0.15)
    assert float(values["velocity_error_m_s"]) == pytest.approx(moved_px * 0.02 * 25)
    assert float(values["position_error_m"]) == pytest.approx(float(values["displacement_reference_px"]) * 0.02)
    graph.until(lambda: said(diagnostics, "frame 1 (1.040 s): displaced by"), "the warning")

    node = "/cam/evaluator_node"
    assert graph.set_parameter(node, "gsd_m", 0.1)[0]
    assert graph.set_parameter(node, "displacement_warn_px", 1.9)[0]
    taken, reason = graph.set_parameter(node, "displacement_warn_px", 3.0)
    assert not taken
    assert "displacement_warn_px: 3 must not lie above displacement_error_px" in reason
    assert not graph.set_parameter(node, "points", 5)[0], "what was prepared stays as it is"
    stream.send(2, shift_px=1)
    graph.until(lambda: len(metrics) == 4, "two more measured")
    values = values_of(metrics[3])
    assert float(values["position_error_m"]) == pytest.approx(float(values["displacement_reference_px"]) * 0.1)
    graph.until(lambda: diagnostics and values_of(diagnostics[-1])["frames_measured"] == "3", "a report of all")
    assert not said(diagnostics, "frame 3")


@pytest.mark.thorough
def test_undistorted_images_are_measured_against_an_undistorted_reference(graph: Graph) -> None:
    """The lens bends the corners by several pixels; the raw first image would be far off."""
    _, metrics, _ = listening(graph)
    graph.start("tracker_node", "/cam", use_camera_info=True, queue_depth=0, wait_for_subscribers=1, start_s=0.0)
    images = graph.speak(Image, "/cam/image_raw")
    infos = graph.speak(CameraInfo, "/cam/camera_info", LATCHED)
    width, height = SIZE
    infos.publish(CameraInfo(width=width, height=height, distortion_model="plumb_bob", d=[-0.2, 0.02, 0.0, 0.0, 0.0],
                             k=[380.0, 0.0, width / 2, 0.0, 380.0, height / 2, 0.0, 0.0, 1.0]))
    for index in range(4):
        shown = picture(translation(0.02 * index, 0.0), SIZE, noise=1.0)
        images.publish(image_message(shown, 10**9 + index * 40_000_000))
    graph.until(lambda: len(metrics) == 4, "every image measured")
    values = [values_of(one) for one in metrics]
    assert [one["outcome"] for one in values] == ["REFERENCE", "MEASURED", "MEASURED", "MEASURED"]
    assert max(float(one["displacement_reference_px"]) for one in values[1:]) < 0.15
