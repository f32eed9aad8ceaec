"""The camera of a saved reference, and one that was told before the node came to resume from it."""

from __future__ import annotations

import pytest
from live_graph import Graph
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo

from stab_ros.io.camera_message import read_camera
from stab_ros.nodes.camera_info_subscription import CameraInfoSubscription
from stab_ros.nodes.qos import LATCHED

_K = [400.0, 0.0, 240.0, 0.0, 400.0, 135.0, 0.0, 0.0, 1.0]


def info(k1: float) -> CameraInfo:
    return CameraInfo(width=480, height=270, distortion_model="plumb_bob", d=[k1, 0.0, 0.0, 0.0, 0.0], k=_K)


@pytest.mark.parametrize(("told_k1", "warned"), [(0.3, True), (-0.1, False)])
def test_the_camera_of_a_saved_reference_replaces_another_and_says_so(
    graph: Graph, capfd: pytest.CaptureFixture[str], told_k1: float, warned: bool
) -> None:
    """A tracker still loads its kernels when the first camera_info comes."""
    graph.node.create_publisher(CameraInfo, "/camera_info", LATCHED).publish(info(told_k1))
    subscription = CameraInfoSubscription(graph.node, lambda: None)
    graph.node.create_timer(0.1, subscription.refresh)
    graph.until(lambda: subscription.camera, "the camera")
    saved = bytes(serialize_message(info(-0.1)))
    subscription.restore(saved)
    assert subscription.camera is not None
    assert subscription.camera.D[0] == read_camera(saved).D[0]
    assert ("camera_info has changed, the camera that took the reference is kept" in capfd.readouterr().err) == warned


def test_one_that_comes_after_images_went_without_is_left_aside_and_told(
    graph: Graph, capfd: pytest.CaptureFixture[str]
) -> None:
    changes: list[str] = []
    subscription = CameraInfoSubscription(graph.node, lambda: changes.append("changed"), needed=lambda: False)
    for _ in range(49):
        subscription.refresh(images_wait=True)
    assert not subscription.given_up
    for _ in range(9):
        subscription.refresh(images_wait=True)
    assert (subscription.given_up, subscription.awaited, changes) == (True, "", ["changed"])
    subscription.locked = True  # images were placed
    graph.node.create_publisher(CameraInfo, "/camera_info", LATCHED).publish(info(0.3))
    graph.node.create_timer(0.1, subscription.refresh)
    said = ""

    def told() -> bool:
        nonlocal said
        said += capfd.readouterr().err
        return "/camera_info comes too late, images are used without calibration" in said

    graph.until(told, "that it comes too late")
    assert subscription.camera is None
    assert "nobody publishes /camera_info, images are used without calibration, by the scale" in said
