"""The camera's motion between frames: against independent mathematics, and with errors that are those of its sigmas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from reach import CAMERA, Reach, along_reach
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from stab_ros.core.geometry import grid, jacobian, normalized
from stab_ros.core.types import FloatArray, Frame
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.camera_twist import Moment, Twist, logarithm, twist_between
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.followed_error import FollowedError, followed_error
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.placement import Motion, Placement, Sighting
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.georeferencing.pose_link import PoseLink
from stab_ros.georeferencing.posed import turned
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.synthetic.sensors import PPK

STEP_NS, FIRST_NS = 40_000_000, 10**9
MAP_M = np.array([[-20.0, -8, 0], [18, -10, 2], [19, 10, 1], [-21, 9, 3], [0, -11, 0], [-8, 5, 2], [9, 2, 0],
                  [2, 11, 1]])
MARK_PX, SURVEY_M, TRACK_PX = 0.3, 0.02, 0.05
PIXELS = grid(CAMERA.size)[::7]
NO_GRAY = np.zeros((1, 1), np.uint8)


# mathematics ----------------------------------------------------------------------------------------------------------
def matrix(pose: Pose) -> FloatArray:
    """(4, 4), from the optical frame to the map."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = pose.cam_R_map.T, pose.position_m
    return T


def exact_twist(first: Pose, second: Pose, interval_s: float) -> FloatArray:
    """(6,), by the general logarithm of matrices."""
    L = np.real(logm(np.linalg.inv(matrix(first)) @ matrix(second))) / interval_s
    return np.array([*L[:3, 3], L[2, 1], L[0, 2], L[1, 0]])


def posed(position_m: Sequence[float], rotation: Rotation) -> Pose:
    return Pose(np.array(position_m, float), rotation.as_matrix().T)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-6, 0.01, 0.049, 0.051, 0.5, 2.0, 3.0])
def test_logarithm_and_its_derivative_are_those_of_matrices(angle_rad: float) -> None:
    rng = np.random.default_rng(3)
    axis = rng.standard_normal(3)
    turn = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis))
    first = posed([100.0, -40, 46], Rotation.random(random_state=5))
    second = posed([101.0, -40.5, 45.8], Rotation.from_matrix(first.cam_R_map.T) * turn)
    x, J = logarithm(first, second)
    np.testing.assert_allclose(x, exact_twist(first, second, 1.0), atol=1e-9)

    def change(step: FloatArray) -> FloatArray:
        return logarithm(turned(first, step[:6]), turned(second, step[6:]))[0]

    differences = np.stack([(change(step) - change(-step)) / 2e-6 for step in 1e-6 * np.eye(12)], axis=1)
    np.testing.assert_allclose(J, differences, atol=2e-8)


def test_motion_is_told_along_the_axes_of_the_optical_frame() -> None:
    """At nadir, the top of the image north: x east, y south, z down; climbing is -z, a turn to the right is +z."""
    def pose(t: float) -> Pose:
        return Pose.of_angles(np.array([2.0 * t, 3.0 * t, 46 + 0.5 * t]), math.pi / 2, math.pi / 2, 0.0)

    def turning(t: float) -> Pose:
        return Pose.of_angles(np.array([0, 0, 46.0]), math.pi / 2 - 0.1 * t, math.pi / 2, 0.0)

    moved, turned_right = (twist_between(*moments([at(0.0), at(0.04)])) for at in (pose, turning))
    assert moved is not None
    assert turned_right is not None
    np.testing.assert_allclose(moved.linear_m_s, [2, -3, -0.5], atol=1e-12)
    np.testing.assert_allclose(moved.angular_rad_s, 0, atol=1e-12)
    np.testing.assert_allclose(turned_right.angular_rad_s, [0, 0, 0.1], atol=1e-12)


def moments(poses: Sequence[Pose], by: Sequence[FloatArray] | None = None) -> list[Moment]:
    """by: for each pose, changes (6, 1) by an error that all share."""
    out = []
    for number, pose in enumerate(poses):
        shared = np.zeros((6, 1)) if by is None else by[number]
        placement = Placement(np.eye(3), pose=pose, pose_covariance=1e-6 * np.eye(6) + shared @ shared.T,
                              pose_link=PoseLink("alike", {"an error": shared}))
        out.append(Moment(FIRST_NS + number * STEP_NS, placement))
    return out


def test_an_error_of_the_whole_map_cancels() -> None:
    """Where the map lies, 10 m off, and how it is turned, 0.1 rad, does not matter to the camera."""
    poses = [along_reach()(t) for t in (0.0, 0.04)]
    alone = twist_between(*moments(poses))
    moved = [10 * np.eye(6)[:, :1] for _ in poses]
    rotated = [0.1 * np.append(np.cross([0, 0, 1.0], pose.position_m), [0, 0, 1.0])[:, None] for pose in poses]
    for by in (moved, rotated):
        together = twist_between(*moments(poses, by))
        assert alone is not None
        assert together is not None
        np.testing.assert_allclose(together.covariance, alone.covariance, rtol=1e-4, atol=1e-7)


def test_an_error_of_the_scale_counts_for_as_much_as_the_camera_moves() -> None:
    poses = [posed([0, 0, 46], Rotation.from_euler("x", 180, degrees=True)),
             posed([1, 0, 46], Rotation.from_euler("x", 180, degrees=True))]
    larger = [0.01 * np.append(pose.position_m, [0, 0, 0])[:, None] for pose in poses]
    alone, scaled = (twist_between(*moments(poses, by)) for by in (None, larger))
    assert alone is not None
    assert scaled is not None
    more = np.diag(scaled.covariance - alone.covariance)
    assert math.sqrt(more[0]) == pytest.approx(0.01 * scaled.linear_m_s[0])
    np.testing.assert_allclose(more[1:], 0, atol=1e-9)


# when there is none ---------------------------------------------------------------------------------------------------
def test_there_is_no_twist_across_gaps_and_other_chains() -> None:
    first, second = moments([along_reach()(t) for t in (0.0, 0.04)])
    assert twist_between(first, second) is not None
    for stamp_ns in (FIRST_NS, FIRST_NS - STEP_NS, FIRST_NS + 1_000_000_001, 0):
        assert twist_between(first, replace(second, stamp_ns=stamp_ns)) is None
    for changed in ({"pose": None}, {"pose_covariance": None}, {"pose_link": None},
                    {"pose_link": PoseLink("another", {})}):
        assert twist_between(first, replace(second, placement=replace(second.placement, **changed))) is None


def test_there_is_no_twist_across_lost_frames_and_of_still_or_uncalibrated_cameras() -> None:
    flight = Flight()
    engine = engine_of(flight.nadir_config(0.0), True)
    told = [None if number == 3 else flight.motion(number, np.random.default_rng(number)) for number in range(6)]
    told[5] = replace(told[5], reset_counter=1) if told[5] is not None else None
    answers = [engine.frame(flight.frame(number), one) for number, one in enumerate(told)]
    assert [one.twist is not None for one in answers] == [False, True, True, False, False, False]
    without = replace(flight.motion(2, np.random.default_rng(2)), covariance=None)
    engine = engine_of(flight.nadir_config(0.0), True)
    assert [engine.frame(flight.frame(number), one).twist for number, one in ((1, told[1]), (2, without))] == [None] * 2
    still = engine_of(GeoreferenceConfig(orientation="stationary_nadir", height_m=46.0), True)
    scaled = engine_of(GeoreferenceConfig(orientation="dynamic_stabilization", gsd_m=0.05), False)
    for engine in (still, scaled):
        assert [engine.frame(flight.frame(number), told[number]).twist for number in range(3)] == [None] * 3


# calibration ----------------------------------------------------------------------------------------------------------
class Flight:
    """A flight whose first view is nadir, its homographies and what a survey tells of it."""

    def __init__(self, seed: int = 0, fit_px: float = 0.05) -> None:
        self._pose_at, self._fit_px, self._seed = along_reach(), fit_px, seed

    def pose(self, number: int) -> Pose:
        """From nadir at frame 0 into the gusts."""
        t, pose = number * STEP_NS / 1e9, self._pose_at(0.0)
        now = self._pose_at(t)
        nadir = Pose.of_angles(pose.position_m, math.pi / 2, math.pi / 2, 0.0)
        return Pose(now.position_m, now.cam_R_map @ pose.cam_R_map.T @ nadir.cam_R_map)

    def view(self, number: int) -> View:
        return View(CAMERA, self.pose(number))

    def frame(self, number: int) -> Frame:
        return Frame(np.zeros(CAMERA.size[::-1], np.uint8), "mono8", FIRST_NS + number * STEP_NS, "cam")

    def motion(self, number: int, rng: np.random.Generator) -> Motion:
        """The homography of a frame to the first one, with the errors that its covariance tells."""
        H = normalized(self.view(0).image_H_map(0.0) @ np.linalg.inv(self.view(number).image_H_map(0.0)))
        J = jacobian(H, PIXELS)
        C = self._fit_px**2 * np.linalg.inv(np.einsum("nij,nik->jk", J, J)) * len(PIXELS) / 16
        return Motion(H + np.append(rng.multivariate_normal(np.zeros(8), C, method="cholesky"), 0).reshape(3, 3), C)

    def nadir_config(self, height_error: float) -> GeoreferenceConfig:
        """height_error: in its sigmas, of 1 m."""
        height_m = float(self.pose(0).position_m[2]) + height_error
        return GeoreferenceConfig(orientation="dynamic_stabilization", height_m=height_m, height_sigma_m=1.0)

    def surveyed(self) -> FloatArray:
        """(8, 3), where the control points are."""
        return np.asarray(MAP_M + np.append(self.pose(0).position_m[:2], 0))

    def gcps(self, rng: np.random.Generator) -> ControlPoints:
        """As marked in the first frame and surveyed."""
        there = self.surveyed()
        marked = self.view(0).project(there) + rng.normal(0, MARK_PX, (8, 2))
        return ControlPoints(tuple("abcdefgh"), marked, there + rng.normal(0, SURVEY_M, (8, 3)))

    def truth(self, number: int) -> FloatArray:
        """(6,), since the frame before."""
        return exact_twist(self.pose(number - 1), self.pose(number), STEP_NS / 1e9)


def engine_of(config: GeoreferenceConfig, calibrated: bool, gcps: ControlPoints | None = None) -> Georeferencer:
    sensors = Sensors(0.0)
    orientation = make_orientation(config, CAMERA, calibrated, gcps=gcps, sensors=sensors)
    return Georeferencer(config, CAMERA, orientation, sensors)


class Scores:
    """Errors in units of what their covariances tell."""

    def __init__(self) -> None:
        self._distances: list[float] = []
        self._ratios: list[FloatArray] = []

    def add(self, twist: Twist | None, truth: FloatArray) -> None:
        assert twist is not None
        off = np.append(twist.linear_m_s, twist.angular_rad_s) - truth
        assert np.linalg.eigvalsh(twist.covariance)[0] > 0
        self._distances.append(math.sqrt(off @ np.linalg.solve(twist.covariance, off) / 6))
        self._ratios.append(off / np.sqrt(np.diag(twist.covariance)))

    @property
    def median(self) -> float:
        """Of the Mahalanobis distances over the root of 6; 0.94 for exact covariances."""
        return float(np.median(self._distances))

    @property
    def within(self) -> float:
        """Share of all components within 2 sigma."""
        return float(np.mean(np.abs(self._ratios) < 2))

    def check(self, low: float = 0.7, within: tuple[float, float] = (0.93, 0.975)) -> None:
        assert low < self.median < 1.2
        assert within[0] < self.within < within[1]


def test_errors_of_a_flight_over_a_nadir_reference_are_as_told() -> None:
    scores = Scores()
    for seed in range(4):
        flight, rng = Flight(seed), np.random.default_rng(seed)
        engine = engine_of(flight.nadir_config(float(rng.normal())), True)
        for number in range(16):
            told = flight.motion(number, rng) if number else Motion(np.eye(3), np.zeros((8, 8)))
            answer = engine.frame(flight.frame(number), told)
            if number:
                scores.add(answer.twist, flight.truth(number))
    scores.check()


@pytest.mark.parametrize("calibrated", [pytest.param(True, marks=pytest.mark.thorough), False])
def test_errors_of_a_flight_with_control_points_in_its_reference_are_as_told(calibrated: bool) -> None:
    """Without a calibration, the focal length is fitted, and its error is that of the heights."""
    scores = Scores()
    for seed in range(6):
        flight, rng = Flight(seed), np.random.default_rng(seed)
        config = GeoreferenceConfig(
            orientation="dynamic_gcps_stabilization", gcp_sigma_px=MARK_PX, gcp_sigma_m=SURVEY_M)
        engine = engine_of(config, calibrated, flight.gcps(rng))
        for number in range(16):
            answer = engine.frame(flight.frame(number), flight.motion(number, rng))
            if number:
                scores.add(answer.twist, flight.truth(number))
    scores.check()


def followed(flight: Flight, number: int, marked: ControlPoints, near: View | None, rng: np.random.Generator,
             ) -> CameraFit:
    """The fit to a frame in which the marked points were found again; each errs by its mark and by tracking."""
    there = flight.surveyed()
    moved = marked.image_px - flight.view(0).project(there)
    pixels = flight.view(number).project(there) + moved + rng.normal(0, TRACK_PX if number else 0, (8, 2))
    noise = PointNoise(MARK_PX, SURVEY_M)
    points = ControlPoints(marked.names, pixels, marked.map_m)
    return fit_camera(points, CAMERA.size, noise=noise) if near is None else (
        fit_pose(points, near.camera, noise=noise, near=near))


@pytest.mark.parametrize("calibrated", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_errors_by_followed_control_points_are_as_told(calibrated: bool) -> None:
    """Marks and survey err by the same in all frames; with nothing shared, sigmas would be several times as large."""
    scores = Scores()
    tracking = np.broadcast_to(TRACK_PX**2 * np.eye(2), (8, 2, 2))
    for seed in range(6):
        flight, rng = Flight(seed), np.random.default_rng(seed)
        marked = flight.gcps(rng)
        first = followed(flight, 0, marked, flight.view(0) if calibrated else None, rng)
        before: Moment | None = None
        for number in range(12):
            fit = followed(flight, number, marked, first.view, rng) if number else first
            error = followed_error(first, fit, np.ones(8, bool), tracking) if number else FollowedError.of_marked(first)
            now = Moment(FIRST_NS + number * STEP_NS, Placement(
                np.eye(3), pose=fit.view.pose, pose_covariance=error.pose_covariance, pose_link=error.pose_link))
            if before is not None:
                scores.add(twist_between(before, now), flight.truth(number))
            before = now
    scores.check()


@pytest.mark.thorough
def test_errors_by_sensors_alone_are_as_told() -> None:
    """Several frames lie between the same samples, so that neighbours share most of their errors."""
    scores = Scores()
    for seed in range(3):
        flight = Reach(along_reach(gust_deg=0.3), 1.5, 25.0, PPK, seed)
        config = GeoreferenceConfig(orientation="dynamic_gps_imu", lever_arm_m=",".join(map(str, PPK.lever_arm_m)))
        scores_of(flight, config, scores, [replace(one, ref_H_cur=None, covariance=None) for one in flight.sightings])
    scores.check()


def test_errors_of_homographies_fused_with_sensors_are_covered() -> None:
    """The filter expects errors of the model (0.1 px, 2 % of the way) that these homographies do not have."""
    scores = Scores()
    for seed in range(2):
        flight = Reach(along_reach(), 3.0, 10.0, PPK, seed)
        config = GeoreferenceConfig(orientation="dynamic_gps_imu", lever_arm_m=",".join(map(str, PPK.lever_arm_m)))
        scores_of(flight, config, scores, flight.sightings)
    scores.check(0.3, (0.93, 1.0))


def scores_of(flight: Reach, config: GeoreferenceConfig, scores: Scores, sightings: Sequence[Sighting]) -> None:
    """Frames placed by the sensors of a flight, and by homographies where there are any."""
    sensors = Sensors(0.0)
    for position in flight.track.positions:
        sensors.add_position(position)
    for attitude in flight.track.attitudes:
        sensors.add_attitude(attitude)
    orientation = make_orientation(config, CAMERA, True, sensors=sensors)
    before: Moment | None = None
    for number, sighting in enumerate(sightings):
        answer = orientation.place(sighting)
        assert isinstance(answer, Placement)
        now = Moment(sighting.stamp_ns, answer)
        if before is not None:
            scores.add(twist_between(before, now),
                       exact_twist(flight.poses[number - 1], flight.poses[number], 1 / flight.fps))
        before = now
