"""camera_info that is missing, late, of another size or without meaning: waited for, or refused with the reason."""

from __future__ import annotations

import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message, stamp_ns
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest

from stab_ros.core.errors import MessageError
from stab_ros.io.camera_message import read_camera
from stab_ros.synthetic.flight import Shot

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
K = [400.0, 0.0, 240.0, 0.0, 400.0, 135.0, 0.0, 0.0, 1.0]


def info(**wrong: object) -> CameraInfo:
    """Of the flight's camera, but for what is `wrong`."""
    fields: dict[str, object] = {"width": 480, "height": 270, "distortion_model": "plumb_bob", "k": K,
                                 "d": [-0.1, 0.01, 0.0, 0.0, 0.0]}
    return CameraInfo(**{**fields, **wrong})


MEANINGLESS: dict[str, tuple[dict[str, object], str]] = {
    "zero K": ({"k": [0.0] * 9}, "K is not calibrated"),
    "NaN in K": ({"k": [math.nan] * 9}, "K and D finite"),
    "infinite focal length": ({"k": [math.inf, *K[1:]]}, "K and D finite"),
    "negative focal length": ({"k": [-400.0, *K[1:]]}, "positive focal lengths"),
    "NaN in D": ({"d": [math.nan, 0.0, 0.0, 0.0, 0.0]}, "K and D finite"),
    "unknown model": ({"distortion_model": "magic"}, "distortion_model 'magic'"),
    "too few coefficients": ({"d": [0.1]}, "1 coefficient does not fit"),
    "roi outside": ({"roi": RegionOfInterest(x_offset=300, width=200, height=270)}, "200x270 px at .300, 0. does not"),
}


@pytest.mark.parametrize("what", MEANINGLESS)
def test_what_means_nothing_is_refused(what: str) -> None:
    wrong, says = MEANINGLESS[what]
    with pytest.raises(MessageError, match=says):
        read_camera(serialize_message(info(**wrong)))


def test_images_wait_for_their_camera(graph: Graph, flight: list[Shot]) -> None:
    tracker = graph.start("tracker_node", use_camera_info=True, queue_depth=0)
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics", 1)
    answers = graph.listen(CameraInfo, "/homography")
    images = graph.speak(Image, "/image_raw")
    infos = graph.speak(CameraInfo, "/camera_info")
    images.publish(image_message(flight[0].image, 1))
    graph.until(lambda: diagnostics and "camera_info" in diagnostics[-1].status[0].message, "the wait for camera_info")

    width, height = flight[0].image.shape[::-1]
    good = CameraInfo(width=width, height=height, distortion_model="plumb_bob", d=[-0.1, 0.01, 0.0, 0.0, 0.0],
                      k=[400.0, 0.0, width / 2, 0.0, 400.0, height / 2, 0.0, 0.0, 1.0])
    uncalibrated = CameraInfo(width=width, height=height, distortion_model="plumb_bob")
    not_a_number = CameraInfo(width=width, height=height, distortion_model="plumb_bob", k=[math.nan] * 9)
    other_size = CameraInfo(width=99, height=99, distortion_model="plumb_bob", d=good.d, k=good.k)
    for info in (uncalibrated, not_a_number):
        infos.publish(info)
    graph.until(lambda: "/camera_info is refused: camera_info: K" in tracker.log, "the reason")
    assert not answers
    infos.publish(good)
    graph.until(lambda: len(answers) == 1, "the image that had waited")
    assert (list(answers[0].k), list(answers[0].d)) == (list(good.k), list(good.d))
    infos.publish(other_size)
    graph.until(lambda: "camera_info has changed" in tracker.log, "the warning")
    images.publish(image_message(flight[1].image, 2))
    graph.until(lambda: len(answers) == 2, "the next answer")
    assert list(answers[1].k) == list(good.k)


def test_camera_of_another_size_is_refused_until_a_right_one_comes(graph: Graph, flight: list[Shot]) -> None:
    tracker = graph.start("tracker_node", use_camera_info=True, queue_depth=0)
    answers = graph.listen(CameraInfo, "/homography")
    images = graph.speak(Image, "/image_raw")
    infos = graph.speak(CameraInfo, "/camera_info", LATCHED)
    height, width = flight[0].image.shape
    K = [400.0, 0.0, width / 2, 0.0, 400.0, height / 2, 0.0, 0.0, 1.0]
    infos.publish(CameraInfo(width=99, height=99, distortion_model="plumb_bob", k=K))
    images.publish(image_message(flight[0].image, 1))
    graph.until(lambda: "camera_info is for 99x99 px, the images have" in tracker.log, "the reason")
    infos.publish(CameraInfo(width=width, height=height, distortion_model="plumb_bob", k=K))

    def answered() -> bool:  # the two topics may overtake each other
        images.publish(image_message(flight[0].image, 2))
        return bool(answers)

    graph.until(answered, "an answer with the right camera")
    assert stamp_ns(answers[0]) == 2
