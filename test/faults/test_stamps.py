"""Clocks as they are in the field: stamps that are zero, come twice, go back or jump; each is counted and survived."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message
from recordings import entries, write_mcap
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo
from stream import TrackedStream

from stab_ros.synthetic.flight import Shot

MS, DAY_NS, T0 = 10**6, 86_400 * 10**9, 1_700_000_000 * 10**9
# stamps of frames 0, 1, 2, ... and what is counted of them
COURSES: dict[str, tuple[list[int], dict[str, int]]] = {
    "all zero": ([0] * 10, {"stamps_zero": 10}),
    "zero now and then": ([T0, T0 + 40 * MS, 0, T0 + 120 * MS, 0, T0 + 200 * MS], {"stamps_zero": 2}),
    "out of order": ([T0 + k * 40 * MS for k in (0, 1, 2, 4, 3, 5, 6)], {"stamps_back": 1}),
    "a loop": ([T0 + k % 5 * 40 * MS for k in range(10)], {"stamps_back": 1}),
    "a day ahead": ([T0 + k * 40 * MS + (k > 4) * DAY_NS for k in range(10)], {"stamps_ahead": 1}),
    "a day back": ([T0 + k * 40 * MS - (k > 4) * DAY_NS for k in range(10)], {"stamps_back": 1}),
    "the end of time": ([T0, T0 + 40 * MS, (2**31 - 1) * 10**9, T0 + 120 * MS], {"stamps_ahead": 1, "stamps_back": 1}),
}


def error_px(found: Any, shot: Shot) -> float:
    """At the far corner."""
    corner = np.array([479.0, 269.0, 1.0])
    a, b = found @ corner, shot.ref_H_cur @ corner
    return float(np.abs(a / a[2] - b / b[2]).max())


@pytest.mark.parametrize(("course", "start_s"), [*((course, 0.0) for course in COURSES), *(
    (course, 0.2) for course in ("all zero", "out of order", "a day ahead"))])  # while answers are deferred
def test_odd_stamps_are_answered_counted_and_said(
    graph: Graph, flight: list[Shot], course: str, start_s: float
) -> None:
    stamps, counted = COURSES[course]
    stream = TrackedStream(graph, start_s=start_s, stale_s=2.0)
    stream.show(*[image_message(flight[k].image, stamp) for k, stamp in enumerate(stamps)])
    stream.until_answered(len(stamps))
    assert stream.stamps == stamps
    assert max(error_px(stream.homography(k), flight[k]) for k in range(len(stamps))) < 0.15
    zero = {f"stamps_{kind}": 0 for kind in ("zero", "duplicate", "back", "ahead")}
    stream.until_told(**{**zero, **counted}, frames_tracked=len(stamps), frames_dropped=0, reset_counter=0)
    words = {"stamps_zero": "header stamp is zero", "stamps_back": "went back", "stamps_ahead": "jumped ahead"}
    for kind in counted:
        stream.until_said(words[kind])
        assert words[kind] in stream.tracker.log


def test_duplicates_are_dropped_and_counted(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph)
    for k in range(6):
        stream.show(*[image_message(flight[k].image, T0 + k * 40 * MS)] * (1 + k % 3))
    stream.until_answered(6)
    stream.until_told(stamps_duplicate=6, frames_dropped=6, frames_in=6, frames_tracked=6)
    assert stream.stamps == [T0 + k * 40 * MS for k in range(6)]
    stream.until_said("dropped as a duplicate")


def test_a_looped_recording_through_tracker_and_evaluator(graph: Graph, flight: list[Shot], tmp_path: Any) -> None:
    bag = write_mcap(tmp_path / "loop.mcap", list(entries(flight)))
    answers = graph.listen(CameraInfo, "/cam/homography", 500)
    metrics = graph.listen(DiagnosticArray, "/cam/evaluator_node/metrics", 500)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.start("evaluator_node", "/cam", wait_for_subscribers=1)
    graph.start("tracker_node", "/cam", queue_depth=0, start_s=0.0, wait_for_subscribers=2)
    player = graph.start("bag_player_node", bag=str(bag), loop=True, rate=2.0, wait_for_subscribers=1)
    graph.until(lambda: len(metrics) > 5 * len(flight), "five rounds measured")
    assert player.stop() == 0
    graph.until(lambda: len(metrics) == len(answers), "all measured")
    stamps = [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in answers]
    for number, stamp in enumerate(stamps):
        (shot,) = (one for one in flight if one.stamp_ns == stamp)
        found = np.array(answers[number].r).reshape(3, 3)
        assert error_px(found, shot) < 0.15, f"answer {number} has drifted"

    def played() -> dict[str, int]:
        told = [one for one in reports if one.status[0].name == "bag_player_node"]
        return {pair.key: int(pair.value) for pair in told[-1].status[0].values if pair.value.isdigit()}

    graph.until(lambda: played()["messages"] >= 2 * len(answers), "the player's last report")  # /height too
    assert played()["rounds"] > 5


def test_a_simulated_clock_that_nobody_tells(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph, use_sim_time=True)
    stream.show(*[image_message(flight[k].image, T0 + k) for k in range(5)])
    stream.until_answered(5)
    stream.until_said("use_sim_time is set, but nobody publishes /clock")
    assert stream.tracker.log.count("nobody publishes /clock") == 1
    clock = graph.node.create_publisher(Clock, "/clock", 1)

    def silent() -> bool:
        message = Clock()
        message.clock.sec = 1_700_000_000
        clock.publish(message)
        return bool(stream.diagnostics) and "/clock" not in stream.diagnostics[-1].status[0].message

    graph.until(silent, "the warning to end with the clock")
