"""The georeference node as users run it: a separate process over DDS, whose answers are those of the engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, TwistWithCovarianceStamped
from georeferenced_stream import (
    CAMERA,
    NODE,
    GeoreferencedStream,
    by_the_engine,
    camera_info,
    motion,
    ortho_H_image,
    shot,
)
from live_graph import Graph, image_message, stamp_ns, values_of
from rclpy.serialization import deserialize_message
from recordings import FRAME_ID, Entry, entries, write_mcap
from recordings import camera_info as recorded_info
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float64, String

from stab_ros.core.types import Frame
from stab_ros.georeferencing.placement import Motion
from stab_ros.io.bag import open_bag
from stab_ros.io.camera_file import CameraFile, write_camera_file
from stab_ros.synthetic.flight import Shot

NADIR: dict[str, Any] = {"orientation": "stationary_nadir", "height_m": 30.0}
POSE, MOTION = "georeference_node/pose", "georeference_node/motion"
MOVING: dict[str, Any] = {"orientation": "dynamic_stabilization", "height_m": 30.0}


def check(stream: GeoreferencedStream, settings: dict[str, Any], frames: Sequence[tuple[Frame, Motion | None]]) -> None:
    """That all answers and orthophotos are the engine's."""
    stream.until_answered(len(frames))
    stream.graph.until(lambda: len(stream.images) == len(stream.infos), "every orthophoto")
    assert [stamp_ns(one) for one in stream.infos] == [frame.stamp_ns for frame, _ in frames]
    engine = by_the_engine(settings)
    for (frame, told), info, image in zip(frames, stream.infos, stream.images, strict=True):
        answer = engine.frame(frame, told)
        H, wanted = ortho_H_image(info), engine.orthophoto(answer)
        assert answer.ortho_H_image is not None
        assert wanted is not None
        np.testing.assert_allclose(H, answer.ortho_H_image, rtol=1e-9, atol=1e-9)
        assert (info.width, info.height) == (image.width, image.height) == wanted.shape[::-1]
        np.testing.assert_array_equal(np.reshape(image.data, wanted.shape), wanted)


def test_stationary_camera_needs_no_tracker(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, NADIR)
    frames = [(shot(number), None) for number in range(4)]
    for frame, _ in frames:
        stream.show(frame)
    check(stream, NADIR, frames)
    assert len(stream.poses) == 4
    assert stream.poses[0].header.frame_id == "map"
    assert stream.poses[0].pose.pose.position.z == pytest.approx(30)
    report = stream.until_reported(frames_placed=4, state="PLACED")
    assert float(report["gsd_m"]) == pytest.approx(30 / 380, rel=0.05)
    assert stream.node.stop() == 0


def test_frames_wait_for_their_homographies(graph: Graph) -> None:
    """Of which some come before the image, some after it and some in bulk, as at the end of a tracker's start."""
    stream = GeoreferencedStream(graph, MOVING)
    frames = [(shot(number), motion(number)) for number in range(8)]
    for frame, _ in frames[:5]:
        stream.show(frame)
    stream.until_reported(frames_waiting=5, frames_placed=0)
    for frame, told in frames:
        stream.tell(frame.stamp_ns, told)
    for frame, _ in frames[5:]:
        stream.show(frame)
    check(stream, MOVING, frames)


def test_live_gives_what_the_command_gives(
    graph: Graph, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    """A tracker with its start, whose first answers come late, and a lens; all numbers of every message."""
    settings: dict[str, Any] = {"orientation": "dynamic_stabilization", "height_m": 40.0}
    size = flight[0].image.shape[1::-1]
    K = np.array([[400.0, 0, 240], [0, 400, 135], [0, 0, 1]])
    info = recorded_info(K, [-0.05, 0.01, 0.0, 0.0, 0.0], size, flight[0].stamp_ns)
    calibrated = [Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", flight[0].stamp_ns, info)]
    flown = write_mcap(tmp_path / "flown.mcap", [*calibrated, *entries(flight)])
    types = {"ortho_info": CameraInfo, "image_ortho": Image, POSE: PoseWithCovarianceStamped,
             MOTION: TwistWithCovarianceStamped, "georeference_node/status": DiagnosticArray}
    heard = {topic: graph.listen(kind, f"/cam/{topic}") for topic, kind in types.items()}
    node = graph.start("georeference_node", "/cam", queue_depth=0, wait_for_subscribers=1, **settings)
    tracker = graph.start("tracker_node", "/cam", queue_depth=0, wait_for_subscribers=1, use_camera_info=True)
    player = graph.start("bag_player_node", bag=str(flown), wait_for_subscribers=2, rate=100.0)
    assert player.wait() == 0
    stamps = {topic: [one.stamp_ns for one in flight[1 if topic == MOTION else 0:]] for topic in types}
    graph.until(lambda: all(len(heard[topic]) == len(stamps[topic]) for topic in types), "every frame answered")
    assert (tracker.stop(), node.stop()) == (0, 0)

    given = [word for name, value in {**settings, "use_camera_info": True}.items()
             for word in ("-p", f"{name}:={str(value).lower()}")]
    done = command("georeference", flown, tmp_path / "offline.mcap", *given)
    assert done.returncode == 0, done.stderr
    with open_bag(tmp_path / "offline.mcap") as bag:
        offline = {topic: [deserialize_message(message.data, kind) for message in bag.messages([f"/cam/{topic}"])]
                   for topic, kind in types.items()}
    for topic, messages in offline.items():
        assert [stamp_ns(one) for one in messages] == stamps[topic]
        for live, same in zip(heard[topic], messages, strict=True):
            assert numbers_of(live) == pytest.approx(numbers_of(same), rel=1e-9, abs=1e-9), topic
    for live, same in zip(heard[POSE], offline[POSE], strict=True):  # of numerical derivatives
        np.testing.assert_allclose(live.pose.covariance, same.pose.covariance, rtol=1e-5, atol=1e-9)
    for live, same in zip(heard[MOTION], offline[MOTION], strict=True):
        assert live.header.frame_id == same.header.frame_id == FRAME_ID
        C = np.reshape(same.twist.covariance, (6, 6))
        assert np.linalg.eigvalsh(C)[0] > 0
        scale = np.sqrt(np.outer(np.diag(C), np.diag(C)))
        assert (np.abs(np.reshape(live.twist.covariance, (6, 6)) - C) / scale).max() < 1e-5
    assert {values_of(one)["state"] for one in heard["georeference_node/status"]} == {"PLACED"}


def numbers_of(message: Any) -> list[float]:
    """All that is told of a frame."""
    if isinstance(message, CameraInfo):
        return [message.width, message.height, *message.k, *message.r, *message.p, *message.d]
    if isinstance(message, Image):
        return [message.width, message.height, float(np.asarray(message.data, np.uint8) @ np.arange(len(message.data)))]
    if isinstance(message, DiagnosticArray):
        return [float(value) for value in values_of(message).values() if value.replace(".", "").isdecimal()]
    if isinstance(message, TwistWithCovarianceStamped):
        moved, turned = message.twist.twist.linear, message.twist.twist.angular
        return [moved.x, moved.y, moved.z, turned.x, turned.y, turned.z]
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def test_stabilised_images_have_no_lens_and_their_homographies_tell_the_camera(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, {**MOVING, "input": "image_stabilized"}, info=False)
    frames = [shot(number) for number in range(3)]
    for number, frame in enumerate(frames):
        stream.show(frame)
        stream.tell(frame.stamp_ns, motion(number))
    stream.until_answered(3)
    engine = by_the_engine(MOVING, stabilized=True)
    for number, (frame, info) in enumerate(zip(frames, stream.infos, strict=True)):
        answer = engine.frame(frame, motion(number))
        assert answer.ortho_H_image is not None
        np.testing.assert_allclose(ortho_H_image(info), answer.ortho_H_image, rtol=1e-9, atol=1e-9)
    assert max(map(abs, stream.infos[0].d)) < 1e-200


def test_frame_without_homography_is_unplaced_and_holds_nobody_up(graph: Graph) -> None:
    """The tracker drops some, loses others, and stops in the end."""
    stream = GeoreferencedStream(graph, {**MOVING, "wait_s": 2.0}, image=False)
    stream.start_tracker()
    for number in range(4):
        stream.show(shot(number))
    stream.tell(shot(0).stamp_ns, motion(0))
    stream.tell(shot(2).stamp_ns, None)
    stream.tell(shot(3).stamp_ns, motion(3))
    states = [one["state"] for one in stream.until_answered(4)]
    assert states == ["PLACED", "UNPLACED", "UNPLACED", "PLACED"]
    stream.show(shot(4))
    states = [one["state"] for one in stream.until_answered(5)]
    assert states[4] == "UNPLACED"
    stream.until_said("/cam/homography is silent, frames do not wait for it")
    stream.show(shot(5))
    stream.tell(shot(6).stamp_ns, motion(6))  # it speaks again
    stream.show(shot(6))
    assert stream.until_answered(7)[6]["state"] == "PLACED"


def test_new_reference_is_told(graph: Graph) -> None:
    """Its place is not known: nothing is placed by the old one."""
    stream = GeoreferencedStream(graph, MOVING, image=False)
    for number in range(2):
        stream.show(shot(number))
        stream.tell(shot(number).stamp_ns, replace(motion(number), reset_counter=number))
    states = stream.until_answered(2)
    assert [one["state"] for one in states] == ["PLACED", "UNPLACED"]
    assert "another reference" in states[1]["reason"]
    stream.until_said("homographies begin anew at stamp 1040000000 ns, with another reference; reset_counter is 1")
    assert not any(stream.infos[1].k)


@pytest.mark.thorough
def test_tracker_that_leaves_the_lens_is_told_of(graph: Graph) -> None:
    """And tells no tracks, as a program that is not ours."""
    stream = GeoreferencedStream(graph, MOVING, image=False)
    stream.start_tracker(track=False, camera=None)
    stream.show(shot(0))
    stream.tell(shot(0).stamp_ns, motion(0))
    assert stream.until_answered(1)[0]["state"] == "PLACED"
    stream.until_said("the tracker does not remove the distortion of this lens")


@pytest.mark.parametrize("kind", [Float64, PointStamped])
def test_water_level_holds_from_its_stamp_on(graph: Graph, kind: Any) -> None:
    stream = GeoreferencedStream(graph, NADIR, image=False)
    levels = graph.speak(kind, "/cam/water_level")
    stream.show(shot(0))
    stream.until_answered(1)
    message = kind()
    if kind is Float64:
        message.data = 1.25
    else:
        message.point.z = 1.25
        message.header.stamp.sec, message.header.stamp.nanosec = 1, 50_000_000
    levels.publish(message)
    graph.until(lambda: stream.reports and "water_level_age_s" in values_of(stream.reports[-1]), "the level")
    for number in (1, 2):
        stream.show(shot(number))
    wanted = [0.0, 1.25, 1.25] if kind is Float64 else [0.0, 0.0, 1.25]
    assert [float(one["wse_m"]) for one in stream.until_answered(3)] == wanted


def test_a_level_that_is_given_counts_for_more_than_that_of_the_camera_file(graph: Graph, tmp_path: Path) -> None:
    """Also one that is the default."""
    write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, wse_m=2.5))
    stream = GeoreferencedStream(graph, {**NADIR, "camera_file": str(tmp_path / "camera.yaml")}, image=False,
                                 info=False)
    stream.show(shot(0))
    stream.until_answered(1)
    assert graph.set_parameter(NODE, "wse_m", 0.0) == (True, "")
    stream.show(shot(1))
    assert [float(one["wse_m"]) for one in stream.until_answered(2)] == [2.5, 0.0]


@pytest.mark.thorough
def test_water_level_of_another_type_is_said(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, NADIR, image=False)
    graph.node.create_publisher(String, "/cam/water_level", 1)
    stream.until_said("/cam/water_level is published as std_msgs/msg/String, nothing is received of it; it must be "
                      "geometry_msgs/msg/PointStamped or std_msgs/msg/Float64")
    stream.show(shot(0))
    assert stream.until_answered(1)[0]["state"] == "PLACED"


def test_hostile_messages_are_refused_and_counted(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, MOVING, image=False)
    levels = graph.speak(PointStamped, "/cam/water_level")
    level = PointStamped()
    level.point.z = float("nan")
    levels.publish(level)
    stream.publish(image_message(shot(0).image, 10**9, step=7))  # damaged
    stream.publish(image_message(shot(0).image[:100], 10**9 + 1))  # of another size than the camera's
    stream.tell(10**9 + 1, motion(0))
    broken = graph.speak(CameraInfo, "/cam/homography")
    broken.publish(CameraInfo(k=[float("nan")] * 9))
    broken.publish(camera_info((0, 0)))
    stream.show(shot(1))
    stream.tell(shot(1).stamp_ns, motion(1))
    assert stream.until_answered(1)[0]["state"] == "PLACED"
    stream.until_said("its height is not finite")
    stream.until_said("the camera takes images of 400x300, not 400x100")
    stream.until_reported(frames_refused=2, frames_placed=1, internal_errors=0)
    assert stream.node.stop() == 0
    assert "Traceback" not in stream.node.log


def test_parameters_change_at_run_time_or_are_refused(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, NADIR, image=False)
    stream.show(shot(0))
    stream.until_answered(1)
    assert graph.set_parameter(NODE, "wse_m", 2.0) == (True, "")
    refusals: dict[str, Any] = {
        "orientation": "magic", "height_m": -1.0, "extent": "1, 2, 3", "gcp_patch_px": 10, "queue_depth": 1,
        "origin": "47, 8, 400",
    }
    for name, value in refusals.items():
        taken, reason = graph.set_parameter(NODE, name, value)
        assert not taken, name
        assert name in reason or "Wrong parameter type" in reason, reason
    taken, reason = graph.set_parameter(NODE, "orientation", "stationary_gcps")
    assert not taken
    assert "gcps_file" in reason
    stream.show(shot(1))
    assert [float(one["wse_m"]) for one in stream.until_answered(2)] == [0.0, 2.0]
    assert graph.set_parameter(NODE, "orientation", "dynamic_stabilization") == (True, "")
    stream.show(shot(2))
    stream.tell(shot(2).stamp_ns, motion(2))
    assert stream.until_answered(3)[2]["orientation"] == "dynamic_stabilization"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-p", "orientation:=magic"], "orientation: 'magic' is unknown"),
        (["-p", "extent:=1"], "extent: "),
        (["-p", "input:=image"], "input: 'image' is unknown"),
        (["-p", "orientation:=stationary_nadir", "-p", "height_m:=0.0"], "stationary_nadir needs height_m"),
        (["-p", "gcps_file:=missing.csv"], "missing.csv"),
    ],
)
def test_bad_parameters_are_one_line_and_exit_code_2(graph: Graph, arguments: list[str], said: str) -> None:
    node = graph.run("georeference_node", ["--ros-args", *arguments])
    assert node.wait() == 2
    (line,) = node.log.splitlines()
    assert line.startswith("georeference_node: ")
    assert said in line
