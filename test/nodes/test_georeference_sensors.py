"""Sensors, control points and the map of the georeference node: what waits, what is refused, what is latched."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, QuaternionStamped
from georeferenced_stream import CAMERA, LATCHED, NODE, GeoreferencedStream, by_the_engine, ortho_H_image, shot
from live_graph import Graph
from live_graph import stamp_ns as stamp_of
from rclpy.serialization import deserialize_message, serialize_message
from recordings import Entry, camera_info, entries, write_mcap
from sensor_msgs.msg import CameraInfo, Imu, NavSatFix
from test_lifecycle import DEACTIVATE, change, reported
from visualization_msgs.msg import MarkerArray

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.georeferencing.samples import AttitudeSample
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose, quaternion_of
from stab_ros.imaging.view import View
from stab_ros.io.bag import open_bag
from stab_ros.io.diagnostics_message import ERROR
from stab_ros.io.homography_message import read_homography
from stab_ros.synthetic.flight import Shot

GPS: dict[str, Any] = {"orientation": "dynamic_gps_imu", "fuse_homographies": False}
ORIGIN = LocalFrame(47.05, 8.3, 0.0)


def stamped(message: Any, taken_ns: int) -> Any:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(taken_ns, 10**9)
    return message


def place(stamp_ns: int) -> FloatArray:
    """Latitude, longitude and height on a straight flight."""
    seconds = stamp_ns / 1e9 - 1
    return np.asarray(ORIGIN.to_geodetic(np.array([[1.5 * seconds, -0.5 * seconds, 30 + 0.1 * seconds]]))[0])


def turn(stamp_ns: int) -> FloatArray:
    """Nearly straight down, and turning."""
    pose = Pose.of_angles(np.zeros(3), 1.2 + 0.1 * stamp_ns / 1e9, 1.5, 0.02)
    return quaternion_of((BODY_R_OPTICAL @ pose.cam_R_map).T)


def fix_message(stamp_ns: int) -> Any:
    latitude, longitude, height = place(stamp_ns)
    message = NavSatFix(latitude=latitude, longitude=longitude, altitude=height, position_covariance_type=2)
    message.status.status = 2
    message.position_covariance = [4e-4, 0.0, 0.0, 0.0, 4e-4, 0.0, 0.0, 0.0, 9e-4]
    return stamped(message, stamp_ns)


def imu_message(stamp_ns: int) -> Any:
    message = stamped(Imu(), stamp_ns)
    q = message.orientation
    q.x, q.y, q.z, q.w = map(float, turn(stamp_ns))
    message.orientation_covariance = [1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 4e-6]
    return message


FIXES = range(10**9 - 120_000_000, 10**9 + 500_000_000, 100_000_000)
TURNS = range(10**9 - 50_000_000, 10**9 + 500_000_000, 20_000_000)


def test_frames_wait_for_samples_after_them_and_get_the_answers_of_the_engine(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, {**GPS, "attitude": "imu"}, image=False)
    fixes, turns = graph.speak(NavSatFix, "/cam/fix"), graph.speak(Imu, "/cam/imu")
    frames = [shot(number) for number in range(6)]
    fixes.publish(fix_message(FIXES[0]))
    for frame in frames:
        stream.show(frame)
    stream.until_reported(frames_waiting=6, frames_placed=0)
    for stamp_ns in FIXES[1:]:
        fixes.publish(fix_message(stamp_ns))
    for stamp_ns in TURNS:
        turns.publish(imu_message(stamp_ns))
    stream.until_answered(6)
    engine = by_the_engine(GPS)
    for stamp_ns in FIXES:
        engine.add_fix(stamp_ns, place(stamp_ns), np.diag([4e-4, 4e-4, 9e-4]))
    for stamp_ns in TURNS:
        engine.add_attitude(AttitudeSample(stamp_ns, turn(stamp_ns), np.diag([1e-6, 1e-6, 4e-6])))
    for frame, info in zip(frames, stream.infos, strict=True):
        answer = engine.frame(frame)
        assert answer.ortho_H_image is not None
        np.testing.assert_allclose(ortho_H_image(info), answer.ortho_H_image, rtol=1e-9, atol=1e-9)
    graph.until(lambda: len(stream.poses) == 6, "every pose")
    assert all(one.pose.covariance[0] > 0 for one in stream.poses)


def test_origin_is_latched_for_who_joins_late(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, {**GPS, "attitude": "imu", "wait_s": 1.0}, image=False)
    fixes, turns = graph.speak(NavSatFix, "/cam/fix"), graph.speak(Imu, "/cam/imu")
    for stamp_ns in FIXES:
        fixes.publish(fix_message(stamp_ns))
    for stamp_ns in TURNS:
        turns.publish(imu_message(stamp_ns))
    stream.show(shot(0))
    assert stream.until_answered(1)[0]["state"] == "PLACED"
    origins = graph.listen(NavSatFix, f"{NODE}/origin", LATCHED)
    graph.until(lambda: origins, "the origin")
    first = place(FIXES[0])
    assert (origins[0].latitude, origins[0].longitude, origins[0].altitude) == (first[0], first[1], 0.0)
    assert origins[0].header.frame_id == "map"
    assert graph.set_parameter(NODE, "wse_m", 1.0) == (True, "")  # another engine, the same map
    stream.show(shot(1))
    graph.until(lambda: len(stream.poses) == 2, "both poses")
    first_m, second_m = (one.pose.pose.position for one in stream.poses)
    assert (second_m.x - first_m.x, second_m.y - first_m.y) == pytest.approx((0.06, -0.02), abs=1e-3)
    assert len(origins) == 1


def test_missing_sensors_are_said_and_hold_nothing_up(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, {**GPS, "wait_s": 1.0}, image=False)
    fixes = graph.speak(NavSatFix, "/cam/fix")
    for stamp_ns in FIXES:
        fixes.publish(fix_message(stamp_ns))
    for number in range(3):
        stream.show(shot(number))
    states = stream.until_answered(3)
    assert {one["state"] for one in states} == {"UNPLACED"}
    assert "attitude" in states[0]["reason"]
    stream.until_said("attitude is silent, frames do not wait for it")


def test_hostile_samples_are_refused_with_a_reason(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, {**GPS, "wait_s": 1.0}, image=False)
    fixes, turns = graph.speak(NavSatFix, "/cam/fix"), graph.speak(QuaternionStamped, "/cam/gimbal")
    nothing = QuaternionStamped()
    nothing.quaternion.w = 0.0
    turns.publish(stamped(nothing, 10**9))
    swapped = fix_message(FIXES[1])
    swapped.latitude, swapped.longitude = 147.0, 8.0
    nowhere = fix_message(FIXES[1])
    nowhere.latitude = math.nan
    far = fix_message(FIXES[1])
    far.latitude = -33.0
    for message in (swapped, nowhere, fix_message(FIXES[0]), far):
        fixes.publish(message)
    for stamp_ns in FIXES[1:]:
        fixes.publish(fix_message(stamp_ns))
    for stamp_ns in TURNS:
        message = stamped(QuaternionStamped(), stamp_ns)
        q = message.quaternion
        q.x, q.y, q.z, q.w = map(float, turn(stamp_ns))
        turns.publish(message)
    stream.show(shot(1))
    assert stream.until_answered(1)[0]["state"] == "PLACED"
    for words in ("its quaternion", "its latitude", "from the origin of the map"):
        stream.until_said(words)
    stream.until_reported(messages_refused=4, internal_errors=0)
    assert stream.node.stop() == 0


def test_control_points_are_shown_and_latched(graph: Graph, tmp_path: Path) -> None:
    names, places, pixels = control_points()
    path = tmp_path / "gcps.csv"
    rows = [f"{name},{x!r},{y!r},{e!r},{n!r},{u!r}" for name, (x, y), (e, n, u) in zip(
        names, pixels.tolist(), places.tolist(), strict=True)]
    path.write_text("\n".join(["name,x,y,X,Y,Z", *rows]) + "\n")
    stream = GeoreferencedStream(graph, {"orientation": "stationary_gcps", "gcps_file": str(path)}, image=False)
    stream.show(shot(0))
    values = stream.until_answered(1)[0]
    assert float(values["rmse_px"]) < 1e-3
    assert values["rejected"] == ""
    shown = graph.listen(MarkerArray, f"{NODE}/gcps", LATCHED)
    graph.until(lambda: shown, "the control points")
    assert {marker.text for marker in shown[0].markers} >= set(names)
    place = stream.poses[0].pose.pose.position
    assert [place.x, place.y, place.z] == pytest.approx([2.0, -3.0, 30.0], abs=1e-3)
    taken, reason = graph.set_parameter(NODE, "gcps_file", str(tmp_path / "none.csv"))
    assert not taken
    assert "none.csv" in reason


@pytest.mark.thorough
def test_points_that_do_not_fit_the_camera_are_said_and_the_node_goes_on(graph: Graph, tmp_path: Path) -> None:
    names, places, pixels = control_points()
    path = tmp_path / "gcps.csv"
    path.write_text("\n".join(["name,x,y,X,Y,Z", *(
        f"{name},{x + 5000},{y},{e},{n},{u}" for name, (x, y), (e, n, u) in zip(names, pixels, places, strict=True))]))
    stream = GeoreferencedStream(graph, {"orientation": "stationary_gcps", "gcps_file": str(path)}, image=False)
    stream.show(shot(0))
    stream.until_said("no frame can be placed: ")
    stream.show(shot(1))
    report = stream.until_reported(frames_refused=2)
    assert report["state"] == "WAITING"
    assert graph.set_parameter(NODE, "height_m", 30.0) == (True, "")
    assert stream.node.process.poll() is None
    stream.show(shot(2))
    stream.until_reported(frames_refused=3)
    assert change(graph, NODE, DEACTIVATE)
    graph.until(lambda: reported(stream.reports, "inactive"), "a report of the pause")
    level, message, state = reported(stream.reports, "inactive")[0]
    assert (level, state) == (ERROR, "INACTIVE")
    assert message.startswith("inactive: no frame can be placed: ")


def control_points() -> tuple[list[str], FloatArray, FloatArray]:
    """Eight, off one plane, as a tilted camera sees them."""
    pose = Pose.of_angles(np.array([2.0, -3.0, 30.0]), 1.4, 1.2, 0.05)
    view = View(CAMERA, pose)
    rng = np.random.default_rng(4)
    ground = view.to_plane(rng.uniform((40, 40), (360, 260), (8, 2)), 0.0)
    places = np.column_stack([ground[:, :2], rng.uniform(-2, 3, 8)])
    return [f"p{number}" for number in range(8)], places, np.asarray(view.project(places))


@pytest.mark.thorough
def test_one_bag_gives_the_same_live_and_from_the_command(
    graph: Graph, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    """Images, calibration, fixes, attitudes and levels of one recording, at a hundred times its speed."""
    info = camera_info(CAMERA.K, CAMERA.D.tolist(), (480, 270), flight[0].stamp_ns)
    until_ns = flight[-1].stamp_ns + 200_000_000
    messages = [Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", 10**9 - 1, info), *entries(flight)]
    for topic, kind, make, every_ms in (("fix", "sensor_msgs/msg/NavSatFix", fix_message, 100),
                                        ("imu", "sensor_msgs/msg/Imu", imu_message, 20),
                                        ("water_level", "geometry_msgs/msg/PointStamped", level_message, 300)):
        messages += [Entry(f"/cam/{topic}", kind, stamp_ns + 5_000_000, bytes(serialize_message(make(stamp_ns))))
                     for stamp_ns in range(10**9 - 130_000_000, until_ns, every_ms * 1_000_000)]
    flown = write_mcap(tmp_path / "flown.mcap", sorted(messages, key=lambda one: one.log_time_ns))
    infos, poses = graph.listen(CameraInfo, "/cam/ortho_info"), graph.listen(PoseWithCovarianceStamped, f"{NODE}/pose")
    graph.start("georeference_node", "/cam", queue_depth=0, wait_for_subscribers=1, attitude="imu",
                water_level_type="PointStamped", **GPS)
    player = graph.start("bag_player_node", bag=str(flown), wait_for_subscribers=1, rate=100.0)
    assert player.wait() == 0
    graph.until(lambda: len(infos) == len(poses) == len(flight), "every frame placed")

    given = [word for name, value in GPS.items() for word in ("-p", f"{name}:={str(value).lower()}")]
    done = command("georeference", flown, tmp_path / "offline.mcap", *given)
    assert done.returncode == 0, done.stderr
    with open_bag(tmp_path / "offline.mcap") as bag:
        same = [read_homography(one.data) for one in bag.messages(["/cam/ortho_info"])]
        origins = [deserialize_message(one.data, NavSatFix) for one in bag.messages([f"{NODE}/origin"])]
    assert [stamp_of(one) for one in infos] == [stamp for stamp, _ in same] == [one.stamp_ns for one in flight]
    for live, (_, H) in zip(infos, same, strict=True):
        assert H is not None
        np.testing.assert_allclose(ortho_H_image(live), H, rtol=1e-9, atol=1e-9)
    heard = graph.listen(NavSatFix, f"{NODE}/origin", LATCHED)
    graph.until(lambda: heard, "the origin")
    assert [(one.latitude, one.longitude, one.altitude) for one in heard] == [
        (one.latitude, one.longitude, one.altitude) for one in origins]


def level_message(stamp_ns: int) -> Any:
    message = stamped(PointStamped(), stamp_ns)
    message.point.z = 0.5 * (stamp_ns / 1e9 - 1)
    return message
