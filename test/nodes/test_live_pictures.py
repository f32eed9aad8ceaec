"""The stabilised picture as users of image_transport and image_proc take it: compressed, and with its camera."""

from __future__ import annotations

import signal
from array import array
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from live_graph import Graph, image_message, stamp_ns
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest
from truth import IDENTITY, SIZE, projective, sampled

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import FloatArray, Gray, Homography
from stab_ros.io.bag import open_bag
from stab_ros.io.camera_message import read_camera
from stab_ros.io.cdr import read_stamp
from stab_ros.synthetic.flight import Shot

pytestmark = pytest.mark.thorough  # nodes that start and end for each case

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STABILIZED = "/cam/image_stabilized"
COMPRESSED, TWIN = f"{STABILIZED}/compressed", f"{STABILIZED}/camera_info"
PLAIN: dict[str, Any] = {"queue_depth": 0, "start_s": 0.0, "wait_for_subscribers": 1}
K = np.array([[380.0, 0, 203], [0, 381, 148], [0, 0, 1]])
D = np.array([-0.12, 0.03, 0.001, -0.0015, 0.004])
_QUARTERS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))

COUNTING = """
import sys, threading
import cv2
from stab_ros.nodes.tracker import main

decoded = 0

def watch(frame, event, called):
    global decoded
    decoded += event == "c_call" and called is cv2.imdecode

threading.setprofile(watch)
sys.setprofile(watch)
try:
    main()
finally:
    print(f"decoded {decoded} images", flush=True)
"""


# compressed ----------------------------------------------------------------------------------------------------------
def decoded(message: CompressedImage) -> Gray:
    return np.asarray(cv2.imdecode(np.frombuffer(bytes(message.data), np.uint8), cv2.IMREAD_UNCHANGED))


def pixels(message: Image) -> FloatArray:
    dtype = {"mono8": np.uint8, "mono16": np.uint16}[message.encoding]
    return np.frombuffer(bytes(message.data), dtype).reshape(message.height, message.width)


def test_compressed_pictures_are_those_of_image_stabilized(graph: Graph, flight: list[Shot]) -> None:
    quality, rate = (f"image_stabilized.compressed.{name}" for name in ("jpeg_quality", "rate"))
    settings: dict[str, Any] = {**PLAIN, quality: 90}
    graph.start("tracker_node", "/cam", **settings, reference_frame="river")
    graph.listen(CameraInfo, "/cam/homography")
    raw, small = graph.listen(Image, STABILIZED), graph.listen(CompressedImage, COMPRESSED)
    camera = graph.speak(Image, "/cam/image_raw")
    graph.until(lambda: graph.node.count_publishers(COMPRESSED), "discovery")

    def show(numbers: range) -> None:
        for number in numbers:
            camera.publish(image_message(flight[number % 10].image, 10**9 + number * 40_000_000))
        graph.until(lambda: raw and stamp_ns(raw[-1]) == 10**9 + numbers[-1] * 40_000_000, "the pictures")

    show(range(10))
    graph.until(lambda: len(small) == 10, "all of them compressed")
    assert {one.format for one in small} == {"mono8; jpeg compressed mono8"}
    assert {one.header.frame_id for one in [*raw, *small]} == {"river"}
    for one, other in zip(small, raw, strict=True):
        assert one.header == other.header
        assert np.abs(decoded(one).astype(int) - pixels(other).astype(int)).mean() < 3

    assert graph.set_parameter("/cam/tracker_node", quality, 10) == (True, "")
    show(range(10, 20))
    graph.until(lambda: len(small) == 20, "all of them compressed")
    assert len(small[-1].data) < len(small[9].data) / 2

    assert graph.set_parameter("/cam/tracker_node", rate, 5.0) == (True, "")
    show(range(20, 41))
    graph.until(lambda: stamp_ns(small[-1]) == 10**9 + 39 * 40_000_000, "the last one that is due")
    assert [round((stamp_ns(one) - 10**9) / 40_000_000) for one in small[20:]] == [20, 24, 29, 34, 39]
    assert not graph.set_parameter("/cam/tracker_node", quality, 101)[0]


def test_compressed_images_are_decoded_once_whatever_is_made_of_them(graph: Graph, flight: list[Shot]) -> None:
    """Counted by a profiler within the tracker's process."""
    tracker = graph.start("tracker_node", "/cam", program=("-c", COUNTING), image_transport="compressed", **PLAIN)
    heard = [graph.listen(CameraInfo, "/cam/homography"), graph.listen(CompressedImage, COMPRESSED),
             graph.listen(Image, STABILIZED), graph.listen(CameraInfo, TWIN),
             graph.listen(Image, "/cam/tracker_node/debug_image")]
    camera = graph.speak(CompressedImage, "/cam/image_raw/compressed")
    graph.until(lambda: graph.node.count_publishers(COMPRESSED), "discovery")
    for shot in flight:
        message = CompressedImage(format="mono8; jpeg compressed mono8")
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(shot.stamp_ns, 10**9)
        message.data = array("B", cv2.imencode(".jpg", shot.image)[1].tobytes())
        camera.publish(message)
    graph.until(lambda: all(len(one) == len(flight) for one in heard), "all that a tracker makes of images")
    assert tracker.stop() == 0
    assert f"decoded {len(flight)} images" in tracker.log


def test_pictures_of_16_bit_are_compressed_without_loss(graph: Graph, flight: list[Shot]) -> None:
    graph.start("tracker_node", "/cam", **PLAIN)
    graph.listen(CameraInfo, "/cam/homography")
    raw, small = graph.listen(Image, STABILIZED), graph.listen(CompressedImage, COMPRESSED)
    camera = graph.speak(Image, "/cam/image_raw")
    graph.until(lambda: graph.node.count_publishers(COMPRESSED), "discovery")
    for shot in flight[:2]:
        deep = shot.image.astype(np.uint16) * 201
        camera.publish(image_message(shot.image, shot.stamp_ns, encoding="mono16", step=2 * deep.shape[1],
                                     data=array("B", deep.tobytes())))
    graph.until(lambda: len(small) == len(raw) == 2, "the pictures")
    for one, other in zip(small, raw, strict=True):
        assert (one.format, other.encoding) == ("mono16; png compressed ", "mono16")
        np.testing.assert_array_equal(decoded(one), pixels(other))


def test_who_takes_no_compressed_pictures_does_not_hold_up_the_tracker(
    graph: Graph, flight: list[Shot], tmp_path: Path
) -> None:
    """A recorder that was stopped, as one behind a dead link, and 100 frames meanwhile; it gets the newest."""
    graph.start("tracker_node", "/cam", queue_depth=1, start_s=0.0, wait_for_subscribers=1)
    answers = graph.listen(CameraInfo, "/cam/homography")
    recorder = graph.start("bag_recorder_node", output=str(tmp_path / "out.mcap"), topics=[COMPRESSED])
    camera = graph.speak(Image, "/cam/image_raw")
    graph.until(lambda: graph.node.count_subscribers(COMPRESSED), "the recorder")
    recorder.process.send_signal(signal.SIGSTOP)

    def show(number: int) -> None:
        camera.publish(image_message(flight[number % 10].image, 10**9 + number * 40_000_000))
        graph.until(lambda: answers and stamp_ns(answers[-1]) == 10**9 + number * 40_000_000, f"answer {number}")

    for number in range(100):
        show(number)
    recorder.process.send_signal(signal.SIGCONT)
    for number in range(100, 110):
        show(number)
    assert recorder.stop() == 0
    with open_bag(tmp_path / "out.mcap") as bag:
        kept = [read_stamp(message.data) for message in bag.messages([COMPRESSED])]
    assert kept == sorted(kept)
    assert kept[-1] >= 10**9 + 100 * 40_000_000


def test_compressed_topics_and_the_twin_follow_the_images_where_they_are_remapped(
    graph: Graph, flight: list[Shot]
) -> None:
    remap = {"image_raw": "/front/image", "image_stabilized": "/river/still"}
    graph.start("tracker_node", "/cam", remap, **PLAIN, image_transport="compressed")
    answers = graph.listen(CameraInfo, "/cam/homography")
    small, twins = graph.listen(CompressedImage, "/river/still/compressed"), graph.listen(
        CameraInfo, "/river/still/camera_info")
    camera = graph.speak(CompressedImage, "/front/image/compressed")
    graph.until(lambda: graph.node.count_publishers("/river/still/compressed"), "discovery")
    camera.publish(CompressedImage(format="mono8; png compressed ",
                                   data=cv2.imencode(".png", flight[0].image)[1].tobytes()))
    graph.until(lambda: answers and small and twins, "the picture")
    assert np.abs(decoded(small[0]).astype(int) - flight[0].image.astype(int)).mean() < 3


# camera_info ---------------------------------------------------------------------------------------------------------
def undistorted(seen: FloatArray) -> FloatArray:
    """Where pixels (n, 2) would lie without the lens: OpenCV's projection, inverted by fixed-point iteration."""
    ideal = seen
    for _ in range(12):
        rays = np.column_stack([(ideal - K[:2, 2]) / K[[0, 1], [0, 1]], np.ones(len(seen))])
        ideal = ideal + seen - cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0][:, 0]
    return ideal


@cache
def whole_sensor() -> Gray:
    return taken(IDENTITY)


def taken(ref_H_cur: Homography, offset: tuple[int, int] = (0, 0), binning: int = 1,
          size: tuple[int, int] = SIZE) -> Gray:
    """What the camera with the lens sees: the whole sensor, or each `binning`-th pixel from `offset` on."""
    total = np.zeros(size[::-1])
    for dx, dy in _QUARTERS:
        x, y = (place.ravel() for place in np.meshgrid(*(np.arange(n) * binning + first for n, first in
                                                         zip(size, offset, strict=True))))
        seen = np.column_stack([x + dx, y + dy])
        ideal = undistorted(seen)
        total += sampled(ref_H_cur, ideal[:, 0].reshape(size[::-1]), ideal[:, 1].reshape(size[::-1]), SIZE, 1)
    return np.asarray(np.clip(np.round(total / 4), 0, 255), np.uint8)


def by_a_pinhole(info: CameraInfo) -> FloatArray:
    """What a pinhole with the P of a CameraInfo sees of the reference: the ray of each pixel, followed."""
    ideal_H_pixel = K @ np.linalg.inv(np.reshape(info.p, (3, 4))[:, :3])
    step = float(ideal_H_pixel[0, 0])
    x, y = np.meshgrid(np.arange(info.width, dtype=float), np.arange(info.height, dtype=float))
    spread = (np.arange(8) - 3.5) / 8
    looks = [sampled(ideal_H_pixel, x + dx, y + dy, SIZE, 1) for dx in spread for dy in spread] if step > 1 else [
        sampled(ideal_H_pixel, x + dx, y + dy, SIZE, 1) for dx, dy in _QUARTERS]
    return np.asarray(np.mean(looks, axis=0))


def rectified(image: FloatArray, info: CameraInfo) -> FloatArray:
    """As image_proc's rectify node: passed along where D is all zero, else by initUndistortRectifyMap."""
    if not any(info.d):
        return image
    intrinsic, P = np.reshape(info.k, (3, 3)), np.reshape(info.p, (3, 4))
    maps = cv2.initUndistortRectifyMap(intrinsic, np.array(info.d), np.reshape(info.r, (3, 3)), P[:, :3],
                                       (info.width, info.height), cv2.CV_32FC1)
    return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR))


def displacement_px(image: FloatArray, truth: FloatArray) -> float:
    """How far the affine map from one to the other (by ECC) moves a corner of the inner picture, at most."""
    inner = np.s_[12:-12, 12:-12]
    start = np.eye(2, 3, dtype=np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-7)
    _, M = cv2.findTransformECC(truth[inner].astype(np.float32), image[inner].astype(np.float32), start,
                                cv2.MOTION_AFFINE, criteria, None, 5)
    height, width = truth[inner].shape
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1.0]])
    return float(np.abs(corners @ M.T - corners[:, :2]).max())


def info_of(**fields: object) -> CameraInfo:
    return CameraInfo(width=SIZE[0], height=SIZE[1], distortion_model="plumb_bob", k=K.ravel(), d=list(D), **fields)


@pytest.mark.parametrize("corrected", [True, False])
@pytest.mark.parametrize(("roi", "scale"), [("60, 40, 280, 200", 0.5), ("", 1.0)])
def test_the_twin_is_the_camera_of_the_picture(graph: Graph, corrected: bool, roi: str, scale: float) -> None:
    graph.start("tracker_node", "/cam", **PLAIN, use_camera_info=corrected, output_roi=roi, output_scale=scale)
    graph.listen(CameraInfo, "/cam/homography")
    images, twins = graph.listen(Image, STABILIZED), graph.listen(CameraInfo, TWIN)
    infos = graph.speak(CameraInfo, "/cam/camera_info", LATCHED)
    infos.publish(info_of())
    camera = graph.speak(Image, "/cam/image_raw")
    # with its lens, a frame that moved fits the reference but nearly
    camera.publish(image_message(whole_sensor(), 1))
    camera.publish(image_message(taken(projective()) if corrected else whole_sensor(), 2))
    graph.until(lambda: len(images) == len(twins) == 2, "the pictures and their cameras")
    assert [one.header for one in images] == [one.header for one in twins]
    image, twin = images[1], twins[1]
    assert (image.width, image.height) == (twin.width, twin.height) == ((140, 100) if roi else SIZE)
    assert (list(twin.r), any(twin.d)) == (list(np.eye(3).ravel()), not corrected)
    straight = rectified(pixels(image).astype(float), twin)
    assert displacement_px(straight, by_a_pinhole(twin)) < 0.02


def test_cut_and_resized_as_image_proc_does(graph: Graph) -> None:
    graph.start("tracker_node", "/cam", **PLAIN, use_camera_info=True)
    graph.listen(CameraInfo, "/cam/homography")
    images, twins = graph.listen(Image, STABILIZED), graph.listen(CameraInfo, TWIN)
    graph.speak(CameraInfo, "/cam/camera_info", LATCHED).publish(info_of())
    graph.speak(Image, "/cam/image_raw").publish(image_message(whole_sensor(), 1))
    graph.until(lambda: images and twins, "the picture and its camera")
    picture, twin = pixels(images[0]).astype(float), twins[0]

    cut = CameraInfo(width=twin.width, height=twin.height, k=twin.k, p=twin.p, d=twin.d, r=twin.r,
                     distortion_model=twin.distortion_model,
                     roi=RegionOfInterest(x_offset=30, y_offset=20, width=200, height=150))  # crop_decimate
    of_cut = read_camera(serialize_message(cut))
    pinhole = CameraInfo(width=200, height=150, p=np.column_stack([of_cut.K, np.zeros(3)]).ravel())
    assert displacement_px(picture[20:170, 30:230], by_a_pinhole(pinhole)) < 0.02

    half = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    scaled = np.diag([0.5, 0.5, 1.0]) @ np.reshape(twin.p, (3, 4))  # resize.cpp
    resized = CameraInfo(width=200, height=150, p=scaled.ravel())
    assert displacement_px(half, by_a_pinhole(resized)) < 0.25 + 0.02  # resize.cpp leaves out half a pixel of each


def test_an_unknown_camera_is_uncalibrated(graph: Graph) -> None:
    graph.start("tracker_node", "/cam", **PLAIN)
    graph.listen(CameraInfo, "/cam/homography")
    twins = graph.listen(CameraInfo, TWIN)
    graph.speak(Image, "/cam/image_raw").publish(image_message(whole_sensor(), 1))
    graph.until(lambda: twins, "the camera")
    assert (twins[0].width, twins[0].height, any(twins[0].k), any(twins[0].p)) == (*SIZE, False, False)


def test_a_lost_frame_shown_as_taken_comes_with_the_camera_that_took_it(graph: Graph) -> None:
    graph.start("tracker_node", "/cam", **PLAIN, use_camera_info=True, on_lost="pass", output_roi="10, 10, 100, 100")
    graph.listen(CameraInfo, "/cam/homography")
    twins = graph.listen(CameraInfo, TWIN)
    graph.speak(CameraInfo, "/cam/camera_info", LATCHED).publish(info_of())
    camera = graph.speak(Image, "/cam/image_raw")
    camera.publish(image_message(whole_sensor(), 1))
    camera.publish(image_message(np.full(SIZE[::-1], 90, np.uint8), 2))
    graph.until(lambda: len(twins) == 2, "the cameras")
    assert [(one.width, one.height, any(one.d)) for one in twins] == [(100, 100, False), (*SIZE, True)]
    np.testing.assert_array_equal(twins[1].k, K.ravel())


def test_a_cut_and_binned_sensor_is_straightened_as_the_whole_one(graph: Graph) -> None:
    offset, size = (20, 10), (180, 140)
    graph.start("tracker_node", "/cam", **PLAIN, use_camera_info=True)
    answers, twins = graph.listen(CameraInfo, "/cam/homography"), graph.listen(CameraInfo, TWIN)
    images = graph.listen(Image, STABILIZED)
    infos = graph.speak(CameraInfo, "/cam/camera_info", LATCHED)
    infos.publish(info_of(binning_x=2, binning_y=2, roi=RegionOfInterest(
        x_offset=offset[0], y_offset=offset[1], width=2 * size[0], height=2 * size[1])))
    camera = graph.speak(Image, "/cam/image_raw")
    H = projective()
    for number, place in enumerate((IDENTITY, H)):
        camera.publish(image_message(taken(place, offset, 2, size), number + 1))
    graph.until(lambda: len(answers) == len(images) == len(twins) == 2, "the answers")
    sensor_M_image = np.array([[2.0, 0, offset[0]], [0, 2, offset[1]], [0, 0, 1]])
    intrinsic, R, P = (np.reshape(values, (3, -1)) for values in (answers[1].k, answers[1].r, answers[1].p))
    np.testing.assert_allclose(sensor_M_image @ intrinsic, K, atol=1e-9)
    measured = P[:, :3] @ R @ np.linalg.inv(intrinsic)
    assert rms_distance(measured, np.linalg.inv(sensor_M_image) @ H @ sensor_M_image, size) < 0.1
    assert displacement_px(pixels(images[1]).astype(float), by_a_pinhole(twins[1])) < 0.1
