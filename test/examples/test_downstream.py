"""The examples of docs/downstream.md: what a consumer makes of images, homographies and the stabilised stream."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import Command
from example_process import EXAMPLES, running
from flights import SIZE, trap
from live_graph import Graph, image_message
from marked_ground import MarkedGround, spot_px
from message_makers import HEADER
from message_package import ROS, compiler
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.types import FloatArray, Gray, LostReason, State, Track
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.warp import warp
from stab_ros.io.homography_message import homography_cdr
from stab_ros.synthetic.flight import Flight, Shot

SOURCE = Path(__file__).with_name("pair_and_warp.cpp")
K = np.array([[380.0, 0, 203], [0, 381, 148], [0, 0, 1]])
D = np.array([-0.12, 0.03, 0.001, -0.0015, 0.004])
GROUND = MarkedGround(K, D, (400, 300), np.array([[70.0, 60.0], [320, 70], [200, 151], [90, 240], [330, 230]]))


def pixels(message: Image) -> FloatArray:
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    return rows.reshape(message.height, message.width, -1).astype(float)


def lens(size: tuple[int, int]) -> CameraInfo:
    return CameraInfo(width=size[0], height=size[1], distortion_model="plumb_bob", k=K.ravel(), d=list(D),
                      r=np.eye(3).ravel(), p=np.column_stack([K, np.zeros(3)]).ravel())


def beyond_interpolation(a: FloatArray, b: FloatArray) -> float:
    """How far two images differ more than places that are rounded to 1/32 px explain it, grey levels at most.

    A place off by 1/64 px along x and y, in both images, changes the grey by no more than 1/16 of the range around it.
    """
    around = np.ones((3, 3), np.uint8)
    reach = np.max([cv2.dilate(one, around) - cv2.erode(one, around) for one in (a, b)], axis=0).reshape(a.shape)
    return float(np.max((np.abs(a - b) - reach / 16)[5:-5, 5:-5]))


# warping by oneself --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("encoding", "with_lens"), [("mono8", False), ("bgr8", True)])
def test_warped_by_oneself_as_image_stabilized(
    graph: Graph, flight: list[Shot], encoding: str, with_lens: bool
) -> None:
    graph.start("tracker_node", queue_depth=0, start_s=0.0, use_camera_info=with_lens, wait_for_subscribers=1)
    stabilized = graph.listen(Image, "/image_stabilized")
    warped = graph.listen(Image, "/warp_node/image_warped")
    with running(graph, "warp_node.py", "-p", "start_s:=0.0"):
        if with_lens:
            infos = graph.speak(CameraInfo, "/camera_info")
            infos.publish(lens((flight[0].image.shape[1], flight[0].image.shape[0])))
        images = graph.speak(Image, "/image_raw")
        graph.until(lambda: images.get_subscription_count() == 2, "the tracker and the consumer")
        for number, shot in enumerate(flight[:4], start=1):
            images.publish(encoded(shot, encoding))
            graph.until(partial(_both, stabilized, warped, number), "the pictures")
    for ours, own in zip(stabilized, warped, strict=True):
        assert (ours.header, ours.encoding, ours.height, ours.width) == (
            own.header, own.encoding, own.height, own.width)
        assert beyond_interpolation(pixels(own), pixels(ours)) <= 1.0
    half_off = cv2.warpAffine(pixels(warped[-1]), np.array([[1, 0, 0.5], [0, 1, 0.5]]), (own.width, own.height))
    assert beyond_interpolation(half_off.reshape(own.height, own.width, -1), pixels(stabilized[-1])) > 5.0


def _both(one: list[Any], other: list[Any], count: int) -> bool:
    return len(one) == len(other) == count


def encoded(shot: Shot, encoding: str) -> Any:
    if encoding == "mono8":
        return image_message(shot.image, shot.stamp_ns)
    colour = cv2.merge([shot.image, 255 - shot.image, shot.image // 2])
    return image_message(shot.image, shot.stamp_ns, encoding="bgr8", step=3 * shot.image.shape[1],
                         data=colour.tobytes())


# as image_proc does --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("use_camera_info", "options", "half_px"), [
    (False, {}, 0.0),
    (True, {"roi": "[41, 33, 320, 250]", "decimation": "2"}, 0.0),
    (False, {"scale": "0.5"}, -0.25),  # resize multiplies the principal point
])
def test_a_pinhole_of_the_reference_sees_the_marks_there(
    graph: Graph, use_camera_info: bool, options: dict[str, str], half_px: float
) -> None:
    graph.start("tracker_node", queue_depth=0, start_s=0.0, use_camera_info=use_camera_info, wait_for_subscribers=1)
    graph.listen(CameraInfo, "/homography")
    pictures, infos = graph.listen(Image, "/rectify_still/image_rect"), graph.listen(
        CameraInfo, "/rectify_still/camera_info")
    words = [word for name, value in options.items() for word in ("-p", f"{name}:={value}")]
    with running(graph, "rectify_still.py", *words):
        cameras, images = graph.speak(CameraInfo, "/camera_info"), graph.speak(Image, "/image_raw")
        graph.until(lambda: graph.node.count_subscribers("/image_stabilized/camera_info"), "the consumer")
        if not use_camera_info:  # else no image is taken before the calibration has come
            said = graph.listen(Log, "/rosout")
            images.publish(image_message(GROUND.taken(np.eye(3), np.zeros(3)), 0))
            graph.until(lambda: any("is zero: the camera is not calibrated" in one.msg for one in said), "the reason")
        cameras.publish(lens(GROUND.size))
        images.publish(image_message(GROUND.taken(np.eye(3), np.zeros(3)), 1))
        graph.until(lambda: len(pictures) == len(infos) == 1, "the reference, rectified")
        if use_camera_info:  # else its lens is still in the pictures, and a homography fits another pose but nearly
            turned = cv2.Rodrigues(np.array([0.004, -0.006, 0.02]))[0]
            images.publish(image_message(GROUND.taken(turned, np.array([0.3, -0.2, 0.4])), 2))
            graph.until(lambda: len(pictures) == len(infos) == 2, "the moved frame, rectified")
    P, shrink = projection(infos[-1]), infos[-1].p[0] / K[0, 0] / max(infos[-1].binning_x, 1)
    seen = np.column_stack([GROUND.marks_m, np.ones(5)]) @ P.T
    expected_px = seen[:, :2] / seen[:, 2:]
    found_px = [spot_px(pixels(pictures[-1])[..., 0], place, 7 * shrink) for place in expected_px + half_px]
    np.testing.assert_allclose(found_px, expected_px + half_px, atol=0.05)


def projection(info: CameraInfo) -> FloatArray:
    """P of the image as published, by REP 104."""
    P = np.reshape(info.p, (3, 4)) - np.array([[0, 0, info.roi.x_offset, 0], [0, 0, info.roi.y_offset, 0], [0] * 4])
    return np.asarray(P / np.array([[max(info.binning_x, 1)], [max(info.binning_y, 1)], [1]]))


# C++ -----------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def consumer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The headers of examples/cpp in a program that takes messages as bytes."""
    gcc = compiler()
    opencv = next((place for place in map(Path, ("/usr/include/opencv4", "/usr/local/include/opencv4"))
                   if (place / "opencv2/calib3d.hpp").is_file()), None)
    if gcc is None or opencv is None:
        pytest.skip("no g++, or no headers of OpenCV (libopencv-dev)")
    if not (ROS / "include/sensor_msgs/sensor_msgs/msg/image.hpp").is_file():
        pytest.skip("no headers of sensor_msgs")
    program = tmp_path_factory.mktemp("cpp") / "pair_and_warp"
    headers = [opencv, ROS / "include", *(ROS / "include").iterdir()]
    libraries = ["sensor_msgs__rosidl_typesupport_fastrtps_cpp", "std_msgs__rosidl_typesupport_fastrtps_cpp",
                 "builtin_interfaces__rosidl_typesupport_fastrtps_cpp", "rosidl_typesupport_fastrtps_cpp", "fastcdr",
                 "opencv_core", "opencv_imgproc", "opencv_calib3d"]
    words = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", str(SOURCE), "-o", str(program),
             f"-I{EXAMPLES / 'cpp'}", *(word for place in headers for word in ("-isystem", str(place))),
             f"-L{ROS / 'lib'}", f"-Wl,-rpath,{ROS / 'lib'}", "-Wl,--allow-shlib-undefined",
             *(f"-l{name}" for name in libraries)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


def written(folder: Path, shots: list[Shot], camera: Camera | None, lost: int) -> tuple[list[Path], list[Path]]:
    """Files with the messages of a flight, as they are on the wire: images and their homographies."""
    images, answers = [], []
    for shot in shots:
        header = replace(HEADER, stamp_ns=shot.stamp_ns)
        images.append(folder / f"image_{shot.index}")
        images[-1].write_bytes(serialize_message(image_message(shot.image, shot.stamp_ns)))
        answers.append(folder / f"homography_{shot.index}")
        track = Track(State.TRACKED, shot.index, shot.stamp_ns, 0, 0, ref_H_cur=shot.ref_H_cur)
        if shot.index == lost:
            track = Track(State.LOST, shot.index, shot.stamp_ns, 0, 0, lost_reason=LostReason.FEW_INLIERS)
        answers[-1].write_bytes(homography_cdr(track, header, shot.image.shape[::-1], camera))
    return images, answers


def consumed(consumer: Path, folder: Path, queue: int, files: list[Path]) -> dict[int, Gray]:
    """What the program makes of the messages in this order, by stamp."""
    folder.mkdir()
    subprocess.run([consumer, str(queue), folder, *files], check=True, timeout=60)
    return {int(path.stem): np.fromfile(path, np.uint8).reshape(SIZE[::-1]) for path in folder.iterdir()}


@pytest.mark.thorough  # compiles
@pytest.mark.parametrize("camera", [None, Camera(K, D, "plumb_bob", SIZE)])
def test_in_cpp_as_in_python(consumer: Path, flight: list[Shot], tmp_path: Path, camera: Camera | None) -> None:
    images, answers = written(tmp_path, flight, camera, lost=2)
    warped = consumed(consumer, tmp_path / "out", len(flight), [*images, *reversed(answers)])
    assert sorted(warped) == [shot.stamp_ns for shot in flight if shot.index != 2]
    for shot in (shot for shot in flight if shot.index != 2):
        own = warped[shot.stamp_ns][..., None].astype(float)
        ours = warp(shot.image, shot.ref_H_cur, SIZE, "linear", camera)
        assert beyond_interpolation(own, ours[..., None].astype(float)) <= 1.0


@pytest.mark.thorough
def test_in_cpp_a_queue_of_ten_loses_the_start(consumer: Path, flight: list[Shot], tmp_path: Path) -> None:
    images, answers = written(tmp_path, flight, None, lost=-1)
    warped = consumed(consumer, tmp_path / "out", 4, [*images, *answers])
    assert sorted(warped) == [shot.stamp_ns for shot in flight[-4:]]


# other programs for velocities ---------------------------------------------------------------------------------------
@pytest.mark.thorough
@pytest.mark.parametrize(("module", "script", "off_m_s"), [
    ("openpiv", ("openpiv_of_bag.py", "still.mcap", "--gap"), 0.05),  # under the GPL-3, and nobody's dependency
    ("pyorc", ("pyorc_of_video.py", "still.mp4", "--every"), 0.15),  # under the AGPL-3
])
def test_measured_by_others_on_what_stabilize_wrote(
    command: Command, tmp_path: Path, module: str, script: tuple[str, str, str], off_m_s: float
) -> None:
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed, as it is no dependency: docs/downstream.md says how to run it")
    speed_m_s, frames, table = 1.0, tmp_path / "frames", tmp_path / "V.csv"
    flown = Flight(trap("kolubara", speed_m_s), SIZE, 32)
    frames.mkdir()
    for shot in flown:
        cv2.imwrite(str(frames / f"{shot.index:03}.png"), shot.image)
    stabilized = command("stabilize", frames, tmp_path / "still.mcap", "--fps", flown.preset.fps, "--video",
                         tmp_path / "still.mp4")
    assert stabilized.returncode == 0
    example, source, step = script
    words = [EXAMPLES / example, tmp_path / source, table, "--gsd", flown.gsd_m, step, 4]
    subprocess.run([sys.executable, *map(str, words)], check=True, timeout=300)
    x_px, y_px, vx_m_s, vy_m_s = np.loadtxt(table, delimiter=",", skiprows=1).T
    inside = (x_px > 180) & (x_px < 300) & (y_px > 95) & (y_px < 175)  # water, also where the map is not sure
    assert inside.sum() >= 20
    np.testing.assert_allclose([np.median(vx_m_s[inside]), np.median(vy_m_s[inside])], [speed_m_s, 0], atol=off_m_s)
