"""What the georeference node takes: windows of image_stabilized, compressed images, sensors that are fused live."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import Command
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from georeferenced_stream import (
    CAMERA,
    LATCHED,
    SIZE,
    GeoreferencedStream,
    binned_info,
    camera_info,
    motion,
    ortho_H_image,
    shot,
)
from live_graph import Graph, values_of
from live_graph import stamp_ns as stamp_of
from rclpy.serialization import deserialize_message, serialize_message
from recordings import Entry, entries, write_mcap
from recordings import camera_info as recorded_info
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, NavSatFix

from stab_ros.core.types import Frame
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose, quaternion_of
from stab_ros.imaging.window import Window
from stab_ros.io.bag import open_bag
from stab_ros.parameters.engines import make_georeferencer
from stab_ros.synthetic.flight import Shot

MOVING: dict[str, Any] = {"orientation": "dynamic_stabilization", "height_m": 30.0}
FUSED: dict[str, Any] = {"orientation": "dynamic_gps_imu", "wse_m": 0.0}
ORIGIN = LocalFrame(47.05, 8.3, 0.0)


def test_windows_of_stabilised_images_show_the_same_ground(graph: Graph) -> None:
    """A part of the reference and beyond, at half its scale; then another window: the engine of each tells."""
    stream = GeoreferencedStream(graph, {**MOVING, "input": "image_stabilized"}, info=False)
    windows = [Window(-40, 30, (360, 240), 0.5)] * 2 + [Window(20, -16, (300, 280))] * 2
    engines = {one: make_georeferencer(MOVING, CAMERA, SIZE, one.window_H_cur(np.eye(3))) for one in windows}
    for number, window in enumerate(windows):
        width, height = window.size(SIZE)
        frame = Frame(np.ascontiguousarray(shot(number).image[:height, :width]), "mono8", shot(number).stamp_ns, "cam")
        stream.tell(frame.stamp_ns, motion(number), window)
        stream.show(frame)
        stream.until_answered(number + 1)
        answer = engines[window].frame(frame, motion(number))
        wanted = engines[window].orthophoto(answer)
        graph.until(lambda: len(stream.images) == len(stream.infos), "the orthophoto")
        assert answer.ortho_H_image is not None
        assert wanted is not None
        np.testing.assert_allclose(ortho_H_image(stream.infos[-1]), answer.ortho_H_image, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(np.reshape(stream.images[-1].data, wanted.shape), wanted)


@pytest.mark.parametrize("info", [camera_info(), binned_info()], ids=["whole", "cut and binned"])
def test_compressed_images_are_placed_as_raw_ones(graph: Graph, info: CameraInfo) -> None:
    """Also where camera_info tells of a larger sensor, of which the images show a part, binned."""
    infos, images = graph.listen(CameraInfo, "/cam/ortho_info"), graph.listen(Image, "/cam/image_ortho")
    graph.start("georeference_node", "/cam", queue_depth=0, wait_for_subscribers=1, image_transport="compressed",
                orientation="stationary_nadir", height_m=30.0)
    graph.node.create_publisher(CameraInfo, "/cam/camera_info", LATCHED).publish(info)
    camera = graph.speak(CompressedImage, "/cam/image_raw/compressed")
    engine = make_georeferencer({"orientation": "stationary_nadir", "height_m": 30.0}, CAMERA, SIZE)
    for number in range(3):
        message = CompressedImage(format="mono8; png compressed")
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(shot(number).stamp_ns, 10**9)
        message.data = cv2.imencode(".png", shot(number).image)[1].tobytes()
        camera.publish(message)
    graph.until(lambda: len(infos) == len(images) == 3, "every orthophoto")
    for number in range(3):
        answer = engine.frame(shot(number))
        wanted = engine.orthophoto(answer)
        assert answer.ortho_H_image is not None
        assert wanted is not None
        np.testing.assert_allclose(ortho_H_image(infos[number]), answer.ortho_H_image, rtol=1e-9, atol=1e-9)
        assert images[number].encoding == "mono8"
        np.testing.assert_array_equal(np.reshape(images[number].data, wanted.shape), wanted)


def test_sensors_are_fused_with_the_tracker_live_as_by_the_command(
    graph: Graph, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    """One recording of images, fixes and attitudes through tracker and georeferencing, at a hundred times its speed."""
    size = flight[0].image.shape[1::-1]
    info = recorded_info(np.array([[400.0, 0, 240], [0, 400, 135], [0, 0, 1]]), [0.0] * 5, size, flight[0].stamp_ns)
    messages = [Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", flight[0].stamp_ns - 1, info), *entries(flight)]
    for topic, kind, make, every_ns in (("fix", "sensor_msgs/msg/NavSatFix", _fix, 100_000_000),
                                        ("imu", "sensor_msgs/msg/Imu", _imu, 20_000_000)):
        messages += [Entry(f"/cam/{topic}", kind, stamp_ns, bytes(serialize_message(make(stamp_ns)))) for stamp_ns in
                     range(flight[0].stamp_ns - 130_000_000, flight[-1].stamp_ns + 250_000_000, every_ns)]
    flown = write_mcap(tmp_path / "flown.mcap", sorted(messages, key=lambda one: one.log_time_ns))
    types = {"ortho_info": CameraInfo, "georeference_node/pose": PoseWithCovarianceStamped,
             "georeference_node/status": DiagnosticArray}
    heard = {topic: graph.listen(kind, f"/cam/{topic}") for topic, kind in types.items()}
    node = graph.start("georeference_node", "/cam", queue_depth=0, wait_for_subscribers=1, attitude="imu", **FUSED)
    graph.start("tracker_node", "/cam", queue_depth=0, wait_for_subscribers=1, use_camera_info=True)
    player = graph.start("bag_player_node", bag=str(flown), wait_for_subscribers=2, rate=100.0)
    assert player.wait() == 0
    graph.until(lambda: all(len(messages) == len(flight) for messages in heard.values()), "every frame answered")
    assert node.stop() == 0

    given = [word for name, value in {**FUSED, "use_camera_info": "true"}.items()
             for word in ("-p", f"{name}:={value}")]
    done = command("georeference", flown, tmp_path / "offline.mcap", *given)
    assert done.returncode == 0, done.stderr
    with open_bag(tmp_path / "offline.mcap") as bag:
        offline = {topic: [deserialize_message(message.data, kind) for message in bag.messages([f"/cam/{topic}"])]
                   for topic, kind in types.items()}
    for live, same in zip(heard["ortho_info"], offline["ortho_info"], strict=True):
        assert stamp_of(live) == stamp_of(same)
        np.testing.assert_allclose(ortho_H_image(live), ortho_H_image(same), rtol=1e-9, atol=1e-9)
    for live, same in zip(heard["georeference_node/pose"], offline["georeference_node/pose"], strict=True):
        one, other = live.pose.pose.position, same.pose.pose.position
        np.testing.assert_allclose([one.x, one.y, one.z], [other.x, other.y, other.z], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(live.pose.covariance, same.pose.covariance, rtol=1e-5, atol=1e-9)
    assert all("innovation" in values_of(one) for one in heard["georeference_node/status"][1:])
    sigmas_m = [one.pose.covariance[0] ** 0.5 for one in heard["georeference_node/pose"]]
    assert sigmas_m[-1] < 0.7 * sigmas_m[0]


def _fix(stamp_ns: int) -> Any:
    """A hover with the noise of a consumer's receiver."""
    at_m = np.array([0.0, 0.0, 30.0]) + np.random.default_rng(stamp_ns).normal(0, 0.5, 3)
    latitude, longitude, height = ORIGIN.to_geodetic(at_m[None])[0].tolist()
    message = NavSatFix(latitude=latitude, longitude=longitude, altitude=height, position_covariance_type=2)
    message.status.status = 0
    message.position_covariance = (0.25 * np.eye(3)).ravel().tolist()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return message


def _imu(stamp_ns: int) -> Any:
    """Straight down, up to half a degree."""
    yaw, pitch, roll = np.array([1.2, 1.55, 0.0]) + np.random.default_rng(stamp_ns + 1).normal(0, 0.01, 3)
    pose, message = Pose.of_angles(np.zeros(3), yaw, pitch, roll), Imu()
    q = message.orientation
    q.x, q.y, q.z, q.w = map(float, quaternion_of((BODY_R_OPTICAL @ pose.cam_R_map).T))
    message.orientation_covariance = (1e-4 * np.eye(3)).ravel().tolist()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return message
