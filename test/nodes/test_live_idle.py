"""`idle:=sleep`: no images are taken while nobody listens, and the reference stays. A process over DDS."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message, stamp_ns, values_of
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from stab_ros.core.geometry import rms_distance
from stab_ros.synthetic.flight import Shot

_LISTENERS = {
    "/homography": CameraInfo, "/image_stabilized": Image, "/image_stabilized/compressed": CompressedImage,
    "/image_stabilized/camera_info": CameraInfo, "/tracker_node/track": DiagnosticArray,
    "/tracker_node/reference_image": Image, "/tracker_node/static_map": Image, "/tracker_node/debug_image": Image,
}


def state(reports: list[DiagnosticArray]) -> str:
    return values_of(reports[-1])["state"] if reports else ""


def test_a_sleeping_tracker_goes_on_against_the_same_reference(graph: Graph, flight: list[Shot]) -> None:
    tracker = graph.start("tracker_node", idle="sleep", queue_depth=0, start_s=0.0)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.until(lambda: state(reports) == "ASLEEP", "the report")
    assert reports[-1].status[0].level == b"\0"
    camera = graph.node.create_publisher(Image, "/image_raw", 100)

    answers: list[CameraInfo] = []
    listener = graph.node.create_subscription(CameraInfo, "/homography", answers.append, 100)
    graph.until(camera.get_subscription_count, "a tracker that wakes up")
    for shot in flight[:3]:
        camera.publish(image_message(shot.image, shot.stamp_ns))
    graph.until(lambda: len(answers) == 3, "the first answers")

    graph.node.destroy_subscription(listener)
    graph.until(lambda: not camera.get_subscription_count(), "a tracker that takes no images")
    for shot in flight[3:6]:
        camera.publish(image_message(shot.image, shot.stamp_ns))
    graph.until(lambda: state(reports) == "ASLEEP", "the report")

    graph.node.create_subscription(CameraInfo, "/homography", answers.append, 100)
    graph.until(camera.get_subscription_count, "a tracker that wakes up again")
    for shot in flight[6:]:
        camera.publish(image_message(shot.image, shot.stamp_ns + 120 * 10**9))  # two minutes later
    graph.until(lambda: len(answers) == 7, "the answers after the sleep")
    for answer, shot in zip(answers, [*flight[:3], *flight[6:]], strict=True):
        assert stamp_ns(answer) % (120 * 10**9) == shot.stamp_ns % (120 * 10**9)
        assert rms_distance(np.reshape(answer.r, (3, 3)), shot.ref_H_cur, (480, 270)) < 0.1
    graph.until(lambda: values_of(reports[-1])["frames_in"] == "7", "the report")
    values = values_of(reports[-1])
    assert (values["frames_dropped"], values["frames_before"], values["reset_counter"]) == ("0", "0", "0")
    assert values["stamps_ahead"] == "0"
    assert "images again after" not in tracker.log


def test_every_listener_wakes_it(graph: Graph) -> None:
    graph.start("tracker_node", idle="sleep")
    camera = graph.node.create_publisher(Image, "/image_raw", 100)
    for topic, kind in _LISTENERS.items():
        listener = graph.node.create_subscription(kind, topic, lambda _: None, 1)
        graph.until(camera.get_subscription_count, f"a tracker that {topic} wakes")
        graph.node.destroy_subscription(listener)
        graph.until(lambda: not camera.get_subscription_count(), "a tracker that takes no images")


def test_by_default_it_tracks_whether_anybody_listens_or_not(graph: Graph, flight: list[Shot]) -> None:
    graph.start("tracker_node", queue_depth=0, start_s=0.0)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.speak(Image, "/image_raw").publish(image_message(flight[0].image, 1))
    graph.until(lambda: state(reports) == "TRACKED", "the report")
