"""A tracker of another name: its parameters reach it, and the other nodes find what it publishes below its name."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from georeferenced_stream import shot
from launch_files import ROOT
from live_graph import Graph, image_message, values_of
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.nodes.qos import LATCHED

pytestmark = pytest.mark.thorough  # nodes that start and end for each case


def _holds(heard: Sequence[object], count: int) -> bool:
    return len(heard) == count


def test_the_shipped_file_holds_and_another_one_says_that_it_does_not(graph: Graph, tmp_path: Path) -> None:
    other, own = tmp_path / "other.yaml", tmp_path / "own.yaml"
    other.write_text("/**/tracker_node:\n  ros__parameters:\n    threshold: 2.5\n")
    own.write_text((ROOT / "config" / "tracker.yaml").read_text().replace("method: direct", "method: klt"))
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    tracker = graph.run("tracker_node", ["--ros-args", "-r", "__node:=stabiliser", "--params-file", str(own),
                                         "--params-file", str(other)])
    graph.until(lambda: reports, "a report")
    assert values_of(reports[0])["method"] == "klt"
    said = f"{other}: nothing of it applies, it is for /**/tracker_node, and this node is /stabiliser"
    graph.until(lambda: said in tracker.log, "that the other file is for another node")
    assert str(own) not in tracker.log


def test_the_reference_of_a_renamed_tracker_is_found(graph: Graph) -> None:
    """By an evaluator that is started late, whose first image is not the reference."""
    graph.start("tracker_node", "/cam", remap={"__node": "stabiliser"}, queue_depth=0, start_s=0.0)
    images = graph.speak(Image, "/cam/image_raw")
    references = graph.listen(Image, "/cam/stabiliser/reference_image", LATCHED)
    images.publish(image_message(shot(0).image, shot(0).stamp_ns))
    graph.until(lambda: references, "the reference")
    heard = graph.listen(DiagnosticArray, "/cam/evaluator_node/metrics")
    evaluator = graph.start("evaluator_node", "/cam")
    graph.until(lambda: graph.node.count_subscribers("/cam/stabiliser/reference_image") == 2, "the evaluator there")
    for number in (1, 2):
        images.publish(image_message(shot(number).image, shot(number).stamp_ns))
        graph.until(partial(_holds, heard, number), "a frame measured")
    assert float(values_of(heard[0])["displacement_reference_px"]) > 0  # the reference itself has 0 to itself
    assert "nobody publishes" not in evaluator.log


def test_a_reference_that_nobody_publishes_is_told_once(graph: Graph) -> None:
    evaluator = graph.start("evaluator_node", "/cam")
    graph.until(lambda: "ready" in evaluator.log, "the evaluator")
    graph.node.create_publisher(Image, "/cam/image_stabilized", 10)
    graph.until(lambda: "nobody publishes" in evaluator.log, "that there is no reference")
    graph.until(lambda: graph.node.count_publishers("/diagnostics"), "it running on")
    (line,) = [one for one in evaluator.log.splitlines() if "nobody publishes" in one]
    assert "nobody publishes /cam/tracker_node/reference_image: the first image is the reference; " in line
    assert "remap it, as -r tracker_node/reference_image:=NAME" in line


@pytest.mark.thorough
def test_a_remapped_reference_is_taken_from_there(graph: Graph) -> None:
    graph.start("evaluator_node", "/cam", remap={"tracker_node/reference_image": "/elsewhere/first"})
    graph.node.create_publisher(Image, "/cam/image_stabilized", 10)
    graph.until(lambda: graph.node.count_subscribers("/elsewhere/first"), "the evaluator at the remapped topic")
    assert not graph.node.count_subscribers("/cam/tracker_node/reference_image")


@pytest.mark.thorough
def test_tracks_of_a_renamed_tracker_reach_georeferencing(graph: Graph) -> None:
    graph.start("tracker_node", remap={"__node": "stabiliser"}, queue_depth=0, start_s=0.0, wait_for_subscribers=1)
    heard = graph.listen(DiagnosticArray, "/georeference_node/status")
    graph.start("georeference_node", orientation="dynamic_stabilization", gsd_m=0.05, queue_depth=0,
                use_camera_info=False)
    images = graph.node.create_publisher(Image, "/image_raw", QoSProfile(depth=10))
    graph.until(lambda: images.get_subscription_count() == 2, "both nodes taking images")
    graph.until(lambda: graph.node.count_subscribers("/stabiliser/track"), "its tracks being found")
    for number in range(3):
        images.publish(image_message(shot(number).image, shot(number).stamp_ns))
    graph.until(lambda: len(heard) == 3, "every frame placed")
    assert {values_of(one)["state"] for one in heard} == {"PLACED"}


@pytest.mark.thorough
def test_homographies_without_tracks_are_told(graph: Graph) -> None:
    node = graph.start("georeference_node", "/cam", orientation="dynamic_stabilization", height_m=25.0,
                       use_camera_info=False)
    graph.speak(Image, "/cam/image_raw")
    told = graph.speak(CameraInfo, "/cam/homography")
    told.publish(CameraInfo(k=np.eye(3).ravel(), r=np.eye(3).ravel(), p=np.eye(3, 4).ravel()))
    graph.until(lambda: "nobody publishes /cam/tracker_node/track: homographies are taken without covariance"
                in node.log, "that tracks are missing")
