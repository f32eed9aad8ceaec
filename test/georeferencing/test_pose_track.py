"""Poses between samples against exact paths and scipy, their covariance by simulation, gaps and repeats."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.interpolation import Limits, attitude_at, position_at
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.pose_track import Mounting, PosePrior, PoseTrack
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose

S = 1_000_000_000


def positions(stamps_s: FloatArray, places: FloatArray, sigma_m: float | None = 0.02) -> list[PositionSample]:
    covariance = None if sigma_m is None else sigma_m**2 * np.eye(3)
    return [PositionSample(round(t * S), place, covariance) for t, place in zip(stamps_s, places, strict=True)]


def attitudes(stamps_s: FloatArray, turned: Rotation, sigma_rad: float | None = 0.001) -> list[AttitudeSample]:
    covariance = None if sigma_rad is None else sigma_rad**2 * np.eye(3)
    return [AttitudeSample(round(t * S), q, covariance) for t, q in zip(stamps_s, turned.as_quat(), strict=True)]


def swaying(t: FloatArray) -> FloatArray:
    return np.column_stack([1.4 * t, np.sin(1.3 * t), 46 + 0.3 * np.cos(2 * t)])


def test_a_spline_follows_a_swaying_flight_where_lines_cut_its_bends() -> None:
    t = np.sort(np.concatenate([np.arange(0, 10, 0.25), [2.31, 4.6]]))  # not evenly spaced
    samples = positions(t, swaying(t))
    worst = {}
    for spline in (False, True):
        errors = []
        for s in np.linspace(1, 9, 83):
            found = position_at(samples, round(s * S), Limits(), spline)
            assert not isinstance(found, Unplaced)
            errors.append(np.abs(found.values - swaying(np.array([s]))[0]).max())
        worst[spline] = max(errors)
    assert worst[True] < 0.25 * worst[False]
    assert worst[False] < 0.025


def test_a_spline_passes_through_samples_and_reproduces_parabolas() -> None:
    t = np.array([0.0, 0.9, 1.5, 3.0, 3.2, 5.0])
    parabola = np.column_stack([t**2, 1 - t, 0.5 * t**2 + t])
    samples = positions(t, parabola)
    for s in (0.9, 1.2, 2.9, 3.0, 3.1):
        found = position_at(samples, round(s * S), Limits(5), spline=True)
        assert not isinstance(found, Unplaced)
        assert found.values == pytest.approx([s**2, 1 - s, 0.5 * s**2 + s], abs=1e-9)


def test_attitudes_turn_as_those_of_scipy() -> None:
    t = np.arange(0, 3, 0.2)
    turned = Rotation.random(len(t), random_state=3)
    slerp = Slerp(t, turned)
    signs = np.where(np.arange(len(t)) % 2, 1, -1)[:, None]  # q and -q are the same attitude
    samples = attitudes(t, Rotation.from_quat(signs * turned.as_quat()))
    for s in (0.0, 0.05, 1.37, 2.8):
        found = attitude_at(samples, round(s * S), Limits())
        assert not isinstance(found, Unplaced)
        assert (Rotation.from_quat(found.values).inv() * slerp(s)).magnitude() < 1e-7


def test_covariance_of_the_pose_is_what_noise_makes_of_it() -> None:
    """2000 draws of two positions and two attitudes, with a lever arm of 2 m, 30 % between the samples."""
    rng = np.random.default_rng(1)
    mounting = Mounting.of_angles((0.5, -0.3, 1.9), 0.2, 1.4, 0.1)
    turned = Rotation.from_euler("ZYX", [[0.7, 0.2, -0.1], [0.75, 0.18, -0.12]])
    places = np.array([[0.0, 0, 46], [1, 0.5, 46.2]])
    by_position, in_body = np.diag([0.02, 0.03, 0.06]) ** 2, np.diag([0.002, 0.003, 0.01]) ** 2

    def prior(noise: FloatArray, turns: FloatArray) -> PosePrior:
        noisy = turned * Rotation.from_rotvec(turns)
        track = PoseTrack(
            [PositionSample(k * S, places[k] + noise[k], by_position) for k in (0, 1)],
            [AttitudeSample(k * S, q, in_body) for k, q in enumerate(noisy.as_quat())], mounting)
        found = track.pose_at(round(0.3 * S))
        assert not isinstance(found, Unplaced)
        return found

    exact = prior(np.zeros((2, 3)), np.zeros((2, 3)))
    changes = []
    for _ in range(2000):
        drawn = prior(rng.standard_normal((2, 3)) * np.sqrt(np.diag(by_position)),
                      rng.standard_normal((2, 3)) * np.sqrt(np.diag(in_body)))
        turn = Rotation.from_matrix(drawn.pose.cam_R_map.T @ exact.pose.cam_R_map).as_rotvec()
        changes.append(np.concatenate([drawn.pose.position_m - exact.pose.position_m, turn]))
    assert exact.covariance is not None
    whitened = np.linalg.solve(np.linalg.cholesky(exact.covariance), np.array(changes).T)
    assert np.abs(np.cov(whitened) - np.eye(6)).max() < 0.12


def test_lever_arm_and_mount_place_the_camera() -> None:
    """A drone that heads north and banks to the right, its camera 0.2 m below the antenna and looking down."""
    bank = Rotation.from_euler("Z", math.pi / 2) * Rotation.from_euler("X", 0.1)
    mounting = Mounting.of_angles((0, 0, 0.2), 0, math.pi / 2, 0)
    track = PoseTrack(positions(np.array([0.0, 1]), np.full((2, 3), 50.0)),
                      attitudes(np.array([0.0, 1]), Rotation.concatenate([bank, bank])), mounting)
    found = track.pose_at(S // 2)
    assert not isinstance(found, Unplaced)
    down = found.pose.cam_R_map[2]  # the view, in the map
    assert down == pytest.approx([-math.sin(0.1), 0, -math.cos(0.1)], abs=1e-9)
    assert found.pose.position_m == pytest.approx(50 + 0.2 * down, abs=1e-9)
    assert found.pose.cam_R_map[1] == pytest.approx([0, -1, 0], abs=1e-9)  # the top of the image is north
    assert np.allclose(Mounting.of_angles((0, 0, 0), 0, 0, 0).body_R_optical, BODY_R_OPTICAL)


@pytest.mark.parametrize(("stamp_s", "said"), [
    (-0.05, None), (1.04, None), (1.2, "after the last position"), (-0.5, "before the first position"),
    (9.0, "nearest position is 8 s away"), (0.5, None),
])
def test_gaps_and_ends_are_said(stamp_s: float, said: str | None) -> None:
    samples = positions(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [1, 0, 0]]))
    found = position_at(samples, round(stamp_s * S), Limits())
    if said is None:
        assert not isinstance(found, Unplaced)
        assert found.values[0] == pytest.approx(stamp_s)
    else:
        assert isinstance(found, Unplaced)
        assert said in found.reason


def test_too_few_samples_are_said() -> None:
    one = positions(np.array([0.0]), np.zeros((1, 3)))
    assert PoseTrack(one, []).pose_at(0) == Unplaced("only one position came yet")
    two = positions(np.array([0.0, 1]), np.zeros((2, 3)))
    assert PoseTrack(two, []).pose_at(0) == Unplaced("no attitude came yet")


def test_extrapolation_costs_certainty() -> None:
    samples = positions(np.array([0.0, 0.1]), np.zeros((2, 3)))
    sigmas = []
    for s in (0.05, 0.1, 0.2):
        found = position_at(samples, round(s * S), Limits())
        assert not isinstance(found, Unplaced)
        assert found.covariance is not None
        sigmas.append(math.sqrt(found.covariance[0, 0]))
    assert sigmas == pytest.approx([0.02 * math.sqrt(0.5), 0.02, 0.02 * math.sqrt(5)])


def test_sensors_that_tell_no_covariance_leave_it_open() -> None:
    t = np.array([0.0, 1])
    still = Rotation.identity(2)
    track = PoseTrack(positions(t, np.zeros((2, 3)), None), attitudes(t, still))
    told = PoseTrack(track.positions, track.attitudes, position_sigma_m=3.0)
    for one, known in ((track, False), (told, True)):
        found = one.pose_at(S // 2)
        assert not isinstance(found, Unplaced)
        assert (found.covariance is not None) is known


def told(rows: list[PositionSample]) -> list[PositionSample]:
    """What the engine keeps of these."""
    sensors = Sensors(0.0)
    for row in rows:
        sensors.add_position(row)
    return sensors.positions


def test_rows_that_repeat_a_fix_are_left_out() -> None:
    """30 rows a second of a fix at 10 Hz: interpolation then follows the flight again."""
    t = np.arange(0, 3, 1 / 30)
    held = swaying(np.floor(t * 10 + 1e-9) / 10)
    rows = positions(t, held)
    kept = told(rows)
    assert len(kept) == 30
    found = position_at(kept, round(1.55 * S), Limits())
    assert not isinstance(found, Unplaced)
    assert found.values == pytest.approx(swaying(np.array([1.55]))[0], abs=0.01)
    on_ground = positions(t, np.zeros((len(t), 3)))
    kept_ns = [sample.stamp_ns for sample in told(on_ground)]
    assert kept_ns == [rows[k].stamp_ns for k in (0, 15, 30, 45, 60, 75)]


def test_a_mounting_that_is_no_rotation_is_refused() -> None:
    with pytest.raises(InputError, match="orthonormal"):
        Mounting(np.zeros(3), 2 * np.eye(3))
    with pytest.raises(InputError, match="lever arm"):
        Mounting(np.array([0, 0, np.nan]))
    assert Pose(np.zeros(3), Mounting().body_R_optical)
