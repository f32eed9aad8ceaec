"""The sensors of a recording: which topics are read, and what is left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.io.attitude_message import Attitude, imu_cdr, quaternion_cdr
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import FLOAT64, IMU, NAV_SAT_FIX, QUATERNION_STAMPED
from stab_ros.io.fix_message import NO_FIX, Fix, fix_cdr
from stab_ros.io.metrics_message import float64_cdr
from stab_ros.io.sensors import SensorTopics, read_sensors

COVARIANCE = np.diag([1.0, 4, 9])
FIXES = [Fix(ns, 55 + 1e-7 * ns, -2.0, 80.0, COVARIANCE) for ns in range(1, 6)]
UP = np.array([0.0, 0, 0, 1])
TYPES = {"fix": NAV_SAT_FIX, "imu": IMU, "gimbal": QUATERNION_STAMPED, "water_level": FLOAT64}


def bag(path: Path, **topics: list[bytes]) -> Path:
    """A recording with these messages, one a ns; __ in the name of a topic stands for /."""
    with BagWriter(path) as writer:
        for name, messages in topics.items():
            topic = "/" + name.replace("__", "/")
            writer.add_topic(topic_of(topic, TYPES[name.rpartition("__")[2]]))
            for ns, message in enumerate(messages):
                writer.write(topic, ns, ns, message)
    return path


def test_sensors_are_read_in_the_order_of_their_stamps(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap", drone__fix=[fix_cdr(fix) for fix in reversed(FIXES)],
               drone__imu=[imu_cdr(Attitude(8, UP))], drone__gimbal=[quaternion_cdr(Attitude(9, UP))],
               water_level=[float64_cdr(12.5)])
    sensors = read_sensors(path)
    assert sensors.topics == SensorTopics("/drone/fix", "/drone/gimbal", "/water_level")
    assert [(fix.stamp_ns, fix.latitude_deg) for fix in sensors.fixes] == [
        (fix.stamp_ns, fix.latitude_deg) for fix in FIXES]
    assert [attitude.stamp_ns for attitude in sensors.attitudes] == [9]
    assert [(level.stamp_ns, level.wse_m) for level in sensors.water_levels] == [(0, 12.5)]
    assert sensors.warnings == ()


def test_a_named_topic_is_read(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap", imu=[imu_cdr(Attitude(8, UP, np.eye(3)))],
               gimbal=[quaternion_cdr(Attitude(9, UP))])
    assert [a.stamp_ns for a in read_sensors(path).attitudes] == [9]
    assert [a.stamp_ns for a in read_sensors(path, SensorTopics(attitude="/imu")).attitudes] == [8]
    with pytest.raises(InputError, match=r"has no topic /gps of type sensor_msgs/msg/NavSatFix, and none"):
        read_sensors(path, SensorTopics(fix="/gps"))


def test_telemetry_is_to_be_made_a_recording_first(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"flight.SRT: is no recording, `stab-ros telemetry .* makes one of it$"):
        read_sensors(tmp_path / "flight.SRT")


def test_of_several_topics_one_must_be_named(tmp_path: Path) -> None:
    fixes = [fix_cdr(fix) for fix in FIXES]
    path = bag(tmp_path / "a.mcap", a__fix=fixes, b__fix=fixes, c__fix=[])
    with pytest.raises(InputError, match=r"several topics of the fix, one must be named: /a/fix, /b/fix$"):
        read_sensors(path)
    assert len(read_sensors(path, SensorTopics(fix="/b/fix")).fixes) == 5


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    lost = [replace(FIXES[0], stamp_ns=ns, status=NO_FIX) for ns in (20, 21)]
    unknown = replace(FIXES[0], stamp_ns=30, covariance_m2=None)
    path = bag(tmp_path / "a.mcap", fix=[*map(fix_cdr, [*FIXES, FIXES[0], *lost, unknown]), b"\0\1\0\0damaged"])
    sensors = read_sensors(path)
    assert len(sensors.fixes) == 6
    assert sensors.warnings == (
        f"{path}: 4 of 10 messages of /fix are left out, most because: it says that there is no fix",
        f"{path}: 1 of 6 messages of /fix: its covariance is unknown (type 0)")
