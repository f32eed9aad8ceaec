"""Usual mistakes with sensors are named, right sensors are left alone; predicted registrations against simulation."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from reach import CAMERA, Reach, along_reach
from scipy.spatial.transform import Rotation

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.pose_track import PosePrior, PoseTrack
from stab_ros.georeferencing.sensor_checks import check_motion, check_samples, check_view
from stab_ros.imaging.pose import Pose, quaternion_of, rotation_of_quaternion
from stab_ros.synthetic.sensors import CONSUMER, PPK, SensorModel

ENU_R_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLIP = np.diag([1.0, -1, -1])


@functools.cache
def oblique() -> Reach:
    return Reach(along_reach(2.0, pitch_deg=60.0), duration_s=15)


def converted(track: PoseTrack, convention: Callable[[FloatArray], FloatArray]) -> PoseTrack:
    return replace(track, attitudes=[
        replace(one, map_q_body=quaternion_of(convention(rotation_of_quaternion(one.map_q_body))))
        for one in track.attitudes])


def up(angle: float) -> FloatArray:
    return np.asarray(Rotation.from_euler("Z", angle).as_matrix())


def yaw(R: FloatArray) -> float:
    return math.atan2(R[1, 0], R[0, 0])


@pytest.mark.parametrize(("convention", "said"), [
    (lambda R: ENU_R_NED.T @ R @ FLIP, "forward, right, down in north, east, down (NED)"),
    (lambda R: R @ FLIP, "its body has axes forward, right, down"),
    (lambda R: ENU_R_NED.T @ R, "its map has axes north, east, down"),
    (lambda R: R.T, "it is the inverse"),
    (lambda R: up(math.pi / 2 - 2 * yaw(R)) @ R, "its yaw is a heading"),
    (lambda R: up(-math.pi / 2) @ R, "its yaw counts from north"),
    (lambda R: up(math.pi) @ R, "its yaw is turned by 180 degrees"),
])
def test_attitudes_of_other_conventions_are_named(convention: Callable[[FloatArray], FloatArray], said: str) -> None:
    flight = oblique()
    found = check_motion(CAMERA, converted(flight.track, convention), flight.sightings, 0.0)
    assert len(found) == 1
    assert "the attitude contradicts the homographies" in found[0]
    assert said in found[0]


@pytest.mark.parametrize("sensors", [PPK, replace(CONSUMER, delay_s=0.0)])
def test_right_sensors_are_left_alone(sensors: SensorModel) -> None:
    for pitch in (60.0, 90.0):
        flight = replace(Reach(along_reach(1.5, pitch_deg=pitch), duration_s=15), sensors=sensors)
        assert check_motion(CAMERA, flight.track, flight.sightings, 0.0) == []


def test_a_still_image_tells_nothing_of_axes() -> None:
    flight = Reach(lambda _: Pose.of_angles(np.array([0, 0, 46.0]), 0.3, 1.5, 0), duration_s=10)
    assert check_motion(CAMERA, converted(flight.track, lambda R: R @ FLIP), flight.sightings, 0.0) == []


@pytest.mark.parametrize(("plane_m", "said"), [
    (-49.0, "95 m above the ground by its sensors, 46 m"), (46 - 46 / 0.3048, "feet are taken for metres")])
def test_a_height_of_another_datum_is_told_by_the_homographies(plane_m: float, said: str) -> None:
    """A flight at 46 m; an undulation of 49 m left out, feet for metres. Mostly translation, which tells height."""
    flight = Reach(along_reach(0.3, 3.0), duration_s=20)
    found = check_motion(CAMERA, flight.track, flight.sightings, plane_m)
    assert len(found) == 1
    assert said in found[0]


def test_elevations_in_feet_over_a_high_river_are_told() -> None:
    """At 346 m over a river at 300 m: what is in feet is the elevation, not the height above the water."""
    flight = Reach(along_reach(0.3, 3.0), duration_s=20)
    in_feet = replace(flight.track, positions=[
        replace(one, position_m=one.position_m + np.array([0, 0, 346 / 0.3048 - 46]))
        for one in flight.track.positions])
    (said,) = check_motion(CAMERA, in_feet, flight.sightings, 300.0)
    assert "835 m above the ground by its sensors, 46 m" in said
    assert "feet are taken for metres" in said


def test_samples_tell_of_themselves() -> None:
    track = oblique().track
    assert check_samples(track.positions, track.attitudes) == []
    bare = [replace(one, covariance_m2=None) for one in track.positions]
    assert check_samples(bare, []) == ["the fix comes without covariance, position_sigma_m is taken"]
    jumped = list(track.positions)
    jumped[40] = replace(jumped[40], position_m=jumped[40].position_m + np.array([12.0, 0, 0]))
    assert "the fix jumps 2 times, the worst by 12." in check_samples(jumped, [])[0]
    wild = converted(track, lambda R: np.asarray(Rotation.from_rotvec(
        57.3 * Rotation.from_matrix(R).as_rotvec()).as_matrix()))
    wilder = replace(wild, attitudes=[
        replace(one, map_q_body=quaternion_of(up(3.0 * k) @ rotation_of_quaternion(one.map_q_body)))
        for k, one in enumerate(wild.attitudes)])
    assert "are degrees taken for radians?" in check_samples([], wilder.attitudes)[0]


def test_a_camera_that_looks_up_is_told() -> None:
    def prior(pitch: float) -> PosePrior:
        return PosePrior(0, Pose.of_angles(np.zeros(3), 0.0, pitch, 0.0), None, np.eye(3))

    assert check_view(prior(1.2)) is None
    upwards, level = check_view(prior(-1.5)), check_view(prior(0.0))
    assert upwards is not None
    assert "looks upwards (pitch -86 degrees)" in upwards
    assert level is not None
    assert "looks level" in level
