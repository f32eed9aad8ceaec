"""An error that nobody foresaw costs the frame at which it comes, and never the node."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from failing_nodes import FAILS
from live_graph import Graph, image_message, values_of
from sensor_msgs.msg import Image
from stream import TrackedStream

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Gray
from stab_ros.synthetic.flight import Shot

PROGRAM = Path(__file__).with_name("failing_nodes.py")


def failing(image: Gray) -> Gray:
    marked = image.copy()
    marked[0, 0] = FAILS
    return marked


def sound(image: Gray) -> Gray:
    kept = image.copy()
    kept[0, 0] = 0
    return kept


def test_the_tracker_answers_the_frame_as_lost_and_goes_on(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph, program=(str(PROGRAM), "tracker_node"))
    tracks = graph.listen(DiagnosticArray, "/tracker_node/track")
    for number, shot in enumerate(flight[:8]):
        image = failing(shot.image) if number in (2, 3, 5) else sound(shot.image)
        stream.show(image_message(image, 1 + number))
    stream.until_answered(8)
    assert stream.stamps == list(range(1, 9))
    assert [bool(stream.homography(number).any()) for number in range(8)] == [n not in (2, 3, 5) for n in range(8)]
    first = np.linalg.inv(flight[0].ref_H_cur)
    for number in (1, 4, 6, 7):
        assert rms_distance(stream.homography(number), first @ flight[number].ref_H_cur, (480, 270)) < 0.1
    message = stream.until_told(internal_errors=3, frames_in=8, frames_tracked=5, frames_lost=3, reset_counter=0)
    assert "internal error: division by zero (ZeroDivisionError in failing_nodes.py, line" in message
    graph.until(lambda: len(tracks) >= 8, "all tracks")
    reasons = [values_of(one)["lost_reason"] for one in tracks]
    assert [reason for reason in reasons if reason] == ["internal error"] * 3
    assert stream.tracker.log.count("Traceback") == 1
    assert stream.tracker.stop() == 0


def test_the_evaluator_leaves_the_frame_out_and_goes_on(graph: Graph, flight: list[Shot]) -> None:
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    metrics = graph.listen(DiagnosticArray, "/evaluator_node/metrics")
    node = graph.start("evaluator_node", program=(str(PROGRAM), "evaluator_node"), wait_for_subscribers=1)
    camera = graph.speak(Image, "/image_stabilized", 100)
    for number in range(6):
        image = failing(flight[0].image) if number in (2, 3) else sound(flight[0].image)
        camera.publish(image_message(image, 1 + number))
    graph.until(lambda: len(metrics) >= 4, "the metrics of the other frames")
    graph.until(lambda: any(values_of(one)["internal_errors"] == "2" for one in reports), "the count")
    told = [one.status[0] for one in reports if values_of(one)["internal_errors"] != "0"]
    assert any("internal error: list index out of range (IndexError in" in one.message for one in told)
    assert max(one.level for one in told) == b"\2"
    assert values_of(reports[-1])["frames_in"] == "6"
    assert node.log.count("Traceback") == 1
    assert node.stop() == 0
