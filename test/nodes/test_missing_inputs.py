"""What a node says while images come and something else that it needs does not: in the log once, and in its reports."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from georeferenced_stream import LATCHED, camera_info, shot
from live_graph import Graph, NodeProcess, image_message
from sensor_msgs.msg import CameraInfo, Image

pytestmark = pytest.mark.thorough  # each waits for seconds in vain
_CAMERA = "messages on /cam/camera_info, nobody publishes it"


class _Messages:
    """Of the reports of the only node."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")

    def until(self, message: str) -> None:
        """That a report begins with it."""
        self._reports.clear()
        self._graph.until(lambda: any(one.status[0].message.startswith(message) for one in self._reports), message)


def _show_images(graph: Graph) -> None:
    """Ten a second, from now on."""
    images, numbers = graph.speak(Image, "/cam/image_raw"), itertools.count()

    def show() -> None:
        taken = shot(next(numbers) % 5)
        images.publish(image_message(taken.image, taken.stamp_ns + next(numbers) * 100_000_000))

    graph.node.create_timer(0.1, show)


def _until_said(graph: Graph, node: NodeProcess, line: str) -> None:
    graph.until(lambda: line in node.log, line)


@pytest.mark.parametrize(("kind", "parameters", "after"), [
    ("tracker_node", {"use_camera_info": True, "start_s": 0.0}, "tracked"),
    ("velocimetry_node", {"height_m": 60.0}, "waiting for messages on /cam/homography, nobody publishes it"),
], ids=["tracker", "velocimetry"])
def test_a_camera_info_that_does_not_come_or_is_refused_is_told(
    graph: Graph, kind: str, parameters: dict[str, Any], after: str
) -> None:
    messages = _Messages(graph)
    node = graph.start(kind, "/cam", **parameters)
    messages.until(f"waiting for images on /cam/image_raw and {_CAMERA}")
    _show_images(graph)
    messages.until(f"waiting for {_CAMERA}")
    _until_said(graph, node, "nobody publishes /cam/camera_info, no image is used before it comes; publish it, or set "
                             "use_camera_info:=false")
    camera = graph.speak(CameraInfo, "/cam/camera_info")
    messages.until("waiting for messages on /cam/camera_info")
    camera.publish(CameraInfo(width=480, height=270, distortion_model="plumb_bob"))
    messages.until("waiting for a usable message on /cam/camera_info, the last one is refused: ")
    camera.publish(camera_info())
    messages.until(after)
    assert node.log.count("nobody publishes /cam/camera_info") == 1


@pytest.mark.parametrize(("kind", "parameters"), [
    ("velocimetry_node", {"gsd_m": 0.05}),
    ("georeference_node", {"orientation": "dynamic_stabilization", "known_distance": "10, 10, 200, 10, 8"}),
], ids=["velocimetry", "georeference"])
def test_a_given_scale_does_without_a_camera_info_that_nobody_publishes(
    graph: Graph, kind: str, parameters: dict[str, Any]
) -> None:
    """As the command with the same parameters."""
    messages = _Messages(graph)
    node = graph.start(kind, "/cam", queue_depth=0, **parameters)
    messages.until(f"waiting for images on /cam/image_raw and {_CAMERA}")
    _show_images(graph)
    messages.until(f"waiting for {_CAMERA}")
    _until_said(graph, node, "nobody publishes /cam/camera_info, images are used without calibration, by the scale")
    messages.until("waiting for messages on /cam/homography, nobody publishes it")
    assert node.log.count("camera_info") == 2  # the same line also names use_camera_info


def test_a_scale_that_is_given_at_run_time_does_without_it_too(graph: Graph) -> None:
    node = graph.start("georeference_node", "/cam", queue_depth=0, orientation="dynamic_stabilization", height_m=60.0)
    _Messages(graph).until("waiting for images on /cam/image_raw")
    _show_images(graph)
    _until_said(graph, node, "nobody publishes /cam/camera_info, no image is used before it comes")
    assert graph.set_parameter("/cam/georeference_node", "gsd_m", 0.05) == (True, "")
    assert graph.set_parameter("/cam/georeference_node", "height_m", 0.0) == (True, "")
    _until_said(graph, node, "nobody publishes /cam/camera_info, images are used without calibration, by the scale")


@pytest.mark.parametrize(("kind", "parameters", "topics"), [
    ("velocimetry_node", {}, ["/cam/homography"]),
    ("georeference_node", {"orientation": "dynamic_gps_imu", "wse_m": 0.0},
     ["/cam/homography", "/cam/fix", "/cam/gimbal or /cam/imu"]),
], ids=["homographies", "sensors"])
def test_homographies_and_sensors_that_nobody_publishes_are_told(
    graph: Graph, kind: str, parameters: dict[str, Any], topics: list[str]
) -> None:
    messages = _Messages(graph)
    graph.node.create_publisher(CameraInfo, "/cam/camera_info", LATCHED).publish(camera_info())
    node = graph.start(kind, "/cam", wait_s=6.0, **parameters)
    messages.until("waiting for images on /cam/image_raw")
    _show_images(graph)
    messages.until("waiting for messages on /cam/homography, nobody publishes it")
    for topic in topics:
        line = f"nobody publishes {topic}: frames wait for it up to 6 s (wait_s), then they go without"
        _until_said(graph, node, line)
        assert node.log.count(line) == 1
    if kind == "velocimetry_node":
        everywhere = "nobody publishes /cam/tracker_node/static_map: velocities are measured everywhere"
        _until_said(graph, node, everywhere)
        for _ in range(7):  # s, in which other warnings come again
            messages.until("")
        assert node.log.count("measured everywhere") == 1
