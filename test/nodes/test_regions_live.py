"""Regions that change while nodes run, as `ros2 param set` sends them."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message, values_of
from live_stream import StabilizedStream, homography_message
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import get_parameter_value
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from truth import IDENTITY, picture, translation

from stab_ros.core.types import Gray
from stab_ros.io.point_cloud import read_cloud

DOCS = (Path(__file__).parents[2] / "docs" / "running_nodes.md").read_text()
LEFT, RIGHT = "[[[0, 0], [190, 0], [190, 299], [0, 299]]]", "[[[210, 0], [399, 0], [399, 299], [210, 299]]]"
MALFORMED = {"[[[0, 0], [1, 1]]]": "at least 3 points", "[0, 410]": "no polygon can be made",
             "none.png": "neither JSON", "[[[9000, 0], [9100, 0], [9100, 90]]]": "roi"}


def param_set(graph: Graph, node: str, name: str, text: str) -> tuple[bool, str]:
    """What `ros2 param set NODE NAME TEXT` does: whether it was taken, and why not."""
    wanted = ParameterMessage(name=name, value=get_parameter_value(string_value=text))
    (result,) = graph.call(SetParameters, f"{node}/set_parameters", SetParameters.Request(parameters=[wanted])).results
    return result.successful, result.reason


def refused(graph: Graph, node: str) -> None:
    for text, why in MALFORMED.items():
        taken, reason = param_set(graph, node, "roi", text)
        assert not taken
        assert why in reason
        assert "\n" not in reason


def halves(k: int) -> Gray:
    """The two halves move apart."""
    left, right = picture(translation(-1.5 * k, 0.0)), picture(translation(1.0 * k, -0.5 * k))
    return np.hstack([left[:, :200], right[:, 200:]])


def test_the_tracker_follows_other_regions_from_the_next_frame_on_to_the_same_reference(graph: Graph) -> None:
    graph.start("tracker_node", queue_depth=0, wait_for_subscribers=1, roi=LEFT)
    answers, tracks = graph.listen(CameraInfo, "homography"), graph.listen(DiagnosticArray, "tracker_node/track")
    images = graph.speak(Image, "image_raw")

    def shown(k: int) -> Any:
        images.publish(image_message(halves(k), k + 1))
        graph.until(lambda: len(answers) == k + 1, "an answer")
        return np.reshape(answers[-1].r, (3, 3))

    for k in range(3):
        np.testing.assert_allclose(shown(k), translation(-1.5 * k, 0.0), atol=0.1)
    refused(graph, "tracker_node")
    np.testing.assert_allclose(shown(3), translation(-4.5, 0.0), atol=0.1)
    assert param_set(graph, "tracker_node", "roi", RIGHT) == (True, "")
    np.testing.assert_allclose(shown(4), translation(4.0, -2.0), atol=0.1)
    assert param_set(graph, "tracker_node", "roi", "") == (True, "")
    assert param_set(graph, "tracker_node", "exclude", RIGHT) == (True, "")
    np.testing.assert_allclose(shown(5), translation(-7.5, 0.0), atol=0.1)
    graph.until(lambda: len(tracks) == 6, "the tracks")
    assert {(values_of(one)["reference_stamp_ns"], values_of(one)["reset_counter"]) for one in tracks} == {("1", "0")}


def test_the_evaluator_measures_in_other_regions(graph: Graph) -> None:
    metrics = graph.listen(DiagnosticArray, "/cam/evaluator_node/metrics")
    graph.start("evaluator_node", "/cam", wait_for_subscribers=1, roi=LEFT)
    stream = StabilizedStream(graph, picture(IDENTITY))

    def displacement_px(image: Gray) -> float:
        number = stream.send(shown=image)
        graph.until(lambda: len(metrics) == number + 1, "a frame measured")
        return float(values_of(metrics[-1])["displacement_reference_px"] or "nan")

    displacement_px(halves(0))
    right_moved = np.hstack([picture(IDENTITY)[:, :200], picture(translation(-1.0, 0.0))[:, 200:]])
    assert displacement_px(right_moved) < 0.1
    refused(graph, "/cam/evaluator_node")
    assert displacement_px(right_moved) < 0.1
    assert param_set(graph, "/cam/evaluator_node", "roi", RIGHT) == (True, "")
    assert displacement_px(right_moved) == pytest.approx(1.0, abs=0.2)  # against the same reference


@pytest.mark.thorough
def test_velocimetry_measures_in_other_regions(graph: Graph) -> None:
    clouds = graph.listen(PointCloud2, "/cam/velocity")
    graph.start("velocimetry_node", "/cam", queue_depth=0, wait_for_subscribers=1, extract_s=0.2, features=200,
                use_camera_info=False, leave_out_bank=False)
    images, homographies = graph.speak(Image, "/cam/image_raw"), graph.speak(CameraInfo, "/cam/homography")
    sent = 0

    def show(count: int) -> None:
        nonlocal sent
        for _ in range(count):
            image = image_message(picture(translation(-0.5 * sent, 0.0)), 10**9 + sent * 40_000_000)
            homography = homography_message(image)
            homography.width, homography.height = image.width, image.height
            homographies.publish(homography)
            images.publish(image)
            sent += 1

    def columns_px(cloud: Any) -> Any:
        return read_cloud(serialize_message(cloud))[1]["x"]

    show(14)
    graph.until(lambda: len(clouds) >= 2, "intervals everywhere")
    assert columns_px(clouds[0]).max() > 210
    refused(graph, "/cam/velocimetry_node")
    assert param_set(graph, "/cam/velocimetry_node", "roi", LEFT) == (True, "")
    so_far = len(clouds)
    show(14)
    graph.until(lambda: len(clouds) >= so_far + 2, "intervals on the left")
    last = columns_px(clouds[-1])
    assert len(last)
    assert last.max() <= 190


def test_the_command_in_the_docs_is_taken(graph: Graph) -> None:
    (line,) = re.findall(r"^    (ros2 param set /camera/tracker_node exclude .*)$", DOCS, re.MULTILINE)
    *_, node, name, text = shlex.split(line)
    graph.start("tracker_node", "/camera")
    assert param_set(graph, node, name, text) == (True, "")
