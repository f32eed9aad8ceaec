"""`stab-ros georeference` tells how the camera moves: `~/motion`, and /tf beside what the recording has of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SIZE
from recordings import FRAME_ID, IMAGE_TOPIC, Entry, camera_info, entries, write_mcap
from rosbags.highlevel import AnyReader
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from stab_ros.cli import main
from stab_ros.core.types import FloatArray
from stab_ros.imaging.pose import Pose
from stab_ros.io.cdr import TF_MESSAGE, Header
from stab_ros.io.topics import TF_STATIC_TOPIC, TF_TOPIC
from stab_ros.io.transform_message import transform_cdr
from stab_ros.synthetic.flight import Shot

K = np.array([[400.0, 0, 240], [0, 400, 135], [0, 0, 1]])
STILL = ["-p", "orientation:=stationary_nadir", "-p", "height_m:=40"]
MOVING = ["-p", "orientation:=dynamic_stabilization", "-p", "height_m:=40"]
NAMESPACE = IMAGE_TOPIC.rpartition("/")[0]
POSE, MOTION = (f"{NAMESPACE}/georeference_node/{name}" for name in ("pose", "motion"))


def recorded(path: Path, shots: Sequence[Shot], more: Sequence[Entry] = (), frame_id: str = FRAME_ID) -> Path:
    first_ns = shots[0].stamp_ns
    info = Entry(f"{NAMESPACE}/camera_info", "sensor_msgs/msg/CameraInfo", first_ns,
                 camera_info(K, [0.0] * 5, SIZE, first_ns))
    taken = list(entries(shots))
    for one in taken[::2]:
        one.message.header.frame_id = frame_id
    return write_mcap(path, [info, *more, *taken])


def transform(child: str, topic: str, stamp_ns: int) -> Entry:
    pose = Pose.of_angles(np.array([0, 0, 1.0]), 0.0, 0.0, 0.0)
    return Entry(topic, TF_MESSAGE, stamp_ns, transform_cdr(pose, Header(stamp_ns, "base_link"), child))


def messages(path: Path, topic: str) -> list[Any]:
    with AnyReader([path]) as bag:
        chosen = [one for one in bag.connections if one.topic == topic]
        return [bag.deserialize(data, one.msgtype) for one, _, data in bag.messages(chosen)]


def matrix(place: Any, q: Any) -> FloatArray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    T[:3, 3] = place.x, place.y, place.z
    return T


def ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def test_motion_and_transforms_are_those_of_the_poses(flight: list[Shot], tmp_path: Path,
                                                      capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "o.mcap"
    assert main(["georeference", str(recorded(tmp_path / "in.mcap", flight)), str(output), *MOVING, "--no-image"]) == 0
    poses, twists, transforms = (messages(output, topic) for topic in (POSE, MOTION, TF_TOPIC))
    assert [ns(one) for one in poses] == [shot.stamp_ns for shot in flight]
    assert [ns(one) for one in twists] == [shot.stamp_ns for shot in flight[1:]]
    placed = [matrix(one.pose.pose.position, one.pose.pose.orientation) for one in poses]
    for (sent,), pose, T in zip((one.transforms for one in transforms), poses, placed, strict=True):
        assert (sent.header.frame_id, sent.child_frame_id, ns(sent)) == ("map", FRAME_ID, ns(pose))
        np.testing.assert_allclose(matrix(sent.transform.translation, sent.transform.rotation), T, atol=1e-12)
    for number, one in enumerate(twists, 1):
        interval_s = (ns(poses[number]) - ns(poses[number - 1])) / 1e9
        L = np.real(logm(np.linalg.inv(placed[number - 1]) @ placed[number])) / interval_s
        linear, angular = one.twist.twist.linear, one.twist.twist.angular
        np.testing.assert_allclose([linear.x, linear.y, linear.z], L[:3, 3], atol=1e-6)
        np.testing.assert_allclose([angular.x, angular.y, angular.z], [L[2, 1], L[0, 2], L[1, 0]], atol=1e-7)
        assert one.header.frame_id == FRAME_ID
        assert np.linalg.eigvalsh(one.twist.covariance.reshape(6, 6))[0] > 0
    assert "/tf" not in capsys.readouterr().err


@pytest.mark.parametrize("topic", [TF_TOPIC, TF_STATIC_TOPIC])
@pytest.mark.parametrize("child", ["imu_link", FRAME_ID])
def test_recorded_transforms_stay_and_a_frame_has_one_parent(flight: list[Shot], tmp_path: Path, topic: str, child: str,
                                                             capsys: pytest.CaptureFixture[str]) -> None:
    own = transform(child, topic, flight[0].stamp_ns)
    path, output = recorded(tmp_path / "in.mcap", flight[:3], [own]), tmp_path / "o.mcap"
    assert main(["georeference", str(path), str(output), *STILL, "--no-image"]) == 0
    said = f"its own transforms tell where {FRAME_ID} is, so that the pose of the camera is not on /tf"
    assert (said in capsys.readouterr().err) == (child == FRAME_ID)
    heard = [message for name in {topic, TF_TOPIC} for message in messages(output, name)]
    sent = [(one.header.frame_id, one.child_frame_id) for message in heard for one in message.transforms]
    assert sorted(sent) == sorted([("base_link", child), *([] if child == FRAME_ID else [("map", FRAME_ID)] * 3)])


def test_images_without_frame_id_have_no_transform_and_a_still_camera_no_motion(
        flight: list[Shot], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, output = recorded(tmp_path / "in.mcap", flight[:3], frame_id=""), tmp_path / "o.mcap"
    assert main(["georeference", str(path), str(output), *STILL, "--no-image"]) == 0
    assert "its images have no frame_id, so that their camera is not on /tf" in capsys.readouterr().err
    assert [len(messages(output, topic)) for topic in (POSE, MOTION, TF_TOPIC)] == [3, 0, 0]
