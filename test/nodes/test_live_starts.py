"""The start of a stream on a slow board, after a pause or a stop: the live answers are those of the engine alone."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from flights import SIZE
from image_publisher import FRAMES, ImagePublisher, by_the_engine, flight, shots
from live_graph import Graph, image_message, stamp_ns, values_of
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.geometry import rms_distance

COMPOSED = """
import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from stab_ros.nodes.tracker_node import TrackerNode

rclpy.init(args=["--ros-args", "-p", "queue_depth:=0", "-p", "stale_s:=0.3", "-p", "wait_for_subscribers:=1"])
node, executor = TrackerNode(), MultiThreadedExecutor(2)
node.prepare()
executor.add_node(node)
try:
    executor.spin()
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


@pytest.mark.thorough
def test_a_pause_after_the_first_frame(graph: Graph) -> None:
    camera = ImagePublisher(graph, stale_s=0.1)
    camera.show(1)
    camera.until_answered(1)
    camera.until_said("no image for")
    time.sleep(1.0)
    camera.show(FRAMES - 1)
    camera.check_engine()


@pytest.mark.thorough
def test_a_stream_that_is_slower_than_its_silence(graph: Graph) -> None:
    camera = ImagePublisher(graph, stale_s=0.1)
    camera.show(8, every_s=0.4)
    camera.show(FRAMES - 8)
    camera.check_engine()


@pytest.mark.thorough
def test_a_tracker_that_is_stopped_in_its_start(graph: Graph) -> None:
    camera = ImagePublisher(graph, stale_s=0.2)
    camera.show(6)
    camera.until_answered(1)
    camera.tracker.process.send_signal(signal.SIGSTOP)
    camera.show(6)
    time.sleep(3.0)
    camera.tracker.process.send_signal(signal.SIGCONT)
    camera.show(FRAMES - 12, every_s=0.02)
    camera.check_engine()


def test_a_tracker_that_compiles_is_there_and_can_be_stopped(graph: Graph, tmp_path: Path) -> None:
    graph.environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    tracker = graph.start("tracker_node")
    graph.until(lambda: "compiling kernels" in tracker.log and reports
                and "kernels to be compiled" in reports[-1].status[0].message, "the compiler at work")
    assert values_of(reports[-1])["state"] == "WAITING"
    assert tracker.stop() == 0
    assert "ready" not in tracker.log
    assert "Traceback" not in tracker.log


@pytest.mark.thorough
def test_a_tracker_without_a_home(graph: Graph) -> None:
    """As a service has none: rcl alone would refuse to start."""
    graph.environment.pop("ROS_LOG_DIR")
    graph.environment["HOME"] = "/proc/1/nowhere"
    tracker = graph.start("tracker_node")
    graph.until(lambda: "ready" in tracker.log, "the tracker ready")
    assert "no log file: /proc/1/nowhere/.ros/log cannot be created; name a folder in ROS_LOG_DIR" in tracker.log
    assert tracker.stop() == 0


def test_a_long_pause_gives_provisional_homographies_and_the_start_goes_on(graph: Graph) -> None:
    camera = ImagePublisher(graph, stale_s=0.1)
    camera.show(6)
    camera.until_answered(6)
    camera.until_said("the buffered frames got provisional homographies")
    graph.until(lambda: values_of(camera.reports[-1])["ground"] == "provisional", "the ground being provisional")
    camera.show(FRAMES - 6)
    camera.until_answered(FRAMES)
    camera.until_said("the ground was chosen anew")
    graph.until(lambda: values_of(camera.reports[-1])["ground"] == "decided", "the ground being decided")
    assert [stamp_ns(one) for one in camera.answers] == [shot.stamp_ns for shot in shots()]
    for number, (answer, track) in enumerate(zip(camera.answers, camera.tracks, strict=True)):
        error_px = rms_distance(np.reshape(answer.r, (3, 3)), flight().ref_H_cur(number), SIZE)
        early = 0 < number < 6
        assert values_of(track)["provisional"] == str(early).lower()
        assert error_px < (3 * float(values_of(track)["sigma_px"]) if early else 0.15)


def test_a_tracker_in_an_executor_of_somebody_else(graph: Graph) -> None:
    """As in a process that composes nodes: silence is noticed by the node's own timers."""
    answers = graph.listen(CameraInfo, "/homography", 500)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    with subprocess.Popen([sys.executable, "-c", COMPOSED], env=graph.environment) as process:
        try:
            images: Any = graph.speak(Image, "/image_raw", 300)
            for shot in shots():
                images.publish(image_message(shot.image, shot.stamp_ns))
            graph.until(lambda: len(answers) == FRAMES, "every frame answered")
            graph.until(lambda: reports and values_of(reports[-1])["state"] == "STALE", "the silence being noticed")
        finally:
            process.send_signal(signal.SIGINT)
    for answer, H in zip(answers, by_the_engine(), strict=True):
        np.testing.assert_allclose(np.reshape(answer.r, (3, 3)), H, rtol=0, atol=1e-9)


@pytest.mark.parametrize("answer_start", ["at_once", "drop"])
def test_frames_of_a_start_that_are_not_to_be_late(answer_start: str, graph: Graph) -> None:
    """From the frame on that ends the start, answers are the engine's."""
    camera = ImagePublisher(graph, answer_start=answer_start)
    camera.show(FRAMES)
    engine = dict(zip([shot.stamp_ns for shot in shots()], by_the_engine(), strict=True))
    graph.until(lambda: camera.answers and stamp_ns(camera.answers[-1]) == shots()[-1].stamp_ns, "the last answer")
    camera.until_answered(len(camera.answers))
    told = {stamp_ns(one): one for one in camera.answers}
    assert len(told) == len(camera.answers)  # no frame twice
    reasons = {stamp_ns(one): values_of(one)["lost_reason"] for one in camera.tracks}
    first_ns = shots()[0].stamp_ns
    of_start = [stamp for stamp in engine if first_ns < stamp < first_ns + 10**9]
    assert of_start
    assert list(told) == [stamp for stamp in engine if answer_start == "at_once" or stamp not in of_start]
    for stamp, answer in told.items():
        if stamp in of_start:
            assert reasons[stamp] == "start under way"
            assert not np.any(answer.k)
        else:
            np.testing.assert_allclose(np.reshape(answer.r, (3, 3)), engine[stamp], rtol=0, atol=1e-9)
            assert reasons[stamp] == ""
    assert "LOST" not in camera.tracker.log
    count = str(len(of_start))
    graph.until(lambda: values_of(camera.reports[-1])["frames_in"] == str(FRAMES), "the report")
    lost, dropped = (count, "0") if answer_start == "at_once" else ("0", count)
    assert (values_of(camera.reports[-1])["frames_lost"], values_of(camera.reports[-1])["frames_dropped"]) == (
        lost, dropped)
