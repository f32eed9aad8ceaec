"""Homographies and sensors together against exact flights: better than either, honest of its errors, and not misled."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from reach import CAMERA, Reach, along_reach, where_seen
from scipy.spatial.transform import Rotation

from stab_ros.core.geometry import apply, jacobian, normalized, shift
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.fusion import Fused, Fusion, FusionSettings
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.placement import Placement, Sighting
from stab_ros.georeferencing.plane_points import PlanePoints
from stab_ros.georeferencing.pose_track import PosePrior
from stab_ros.georeferencing.posed import map_H_image_of, placed, turned
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.synthetic.sensors import PPK

POINTS = np.array([[e, n, 0.0] for e in (-18, 0, 15) for n in np.arange(-10, 80, 6.0)])
WHITE, SLOW = (FusionSettings(slow_share=share, relief_share=0.0) for share in (0.0, 0.5))  # on ground that is a plane
DRIFTING = replace(PPK, position_sigma_m=(0.014,) * 3, drift_sigma_m=(0.014,) * 3)


@functools.cache
def reach(slow: bool = False, seed: int = 1, followed_m: float = 0.0) -> Reach:
    return Reach(along_reach(), 40, 5, DRIFTING if slow else PPK, seed, followed_m=followed_m)


def prior_of(flight: Reach, k: int) -> PosePrior:
    prior = flight.track.pose_at(flight.stamp_ns(k))
    assert not isinstance(prior, Unplaced)
    return prior


@functools.cache
def clean(slow: bool = False, seed: int = 1) -> list[Fused]:
    return fused(reach(slow, seed), SLOW if slow else WHITE)


def fused(flight: Reach, settings: FusionSettings, sightings: list[Sighting] | None = None,
          prior: Callable[[int], PosePrior | None] | None = None) -> list[Fused]:
    fusion, out = Fusion(CAMERA, settings), []
    for k, sighting in enumerate(sightings or flight.sightings):
        answer = fusion.update(sighting, prior_of(flight, k) if prior is None else prior(k))
        assert isinstance(answer, Fused)
        out.append(answer)
    return out


def error(flight: Reach, k: int, pose: Pose) -> FloatArray:
    """(6,) of the position, m, and rotations about the axes of the map."""
    exact = flight.poses[k]
    turn = Rotation.from_matrix(pose.cam_R_map.T @ exact.cam_R_map).as_rotvec()
    return np.concatenate([pose.position_m - exact.position_m, turn])


def ground_rms(flight: Reach, maps: Iterator[Homography]) -> float:
    off = []
    for k, H in enumerate(maps):
        chosen, pixels = where_seen(flight.view(k), POINTS)
        off.append(np.sum((apply(H, pixels) - POINTS[chosen, :2]) ** 2, axis=1))
    return float(np.sqrt(np.concatenate(off).mean()))


@pytest.mark.parametrize("slow", [False, True])
def test_both_together_are_better_than_either(slow: bool) -> None:
    flight = reach(slow)
    frames = range(len(flight.poses))
    by_sensors = ground_rms(flight, (map_H_image_of(CAMERA, prior_of(flight, k).pose, 0.0) for k in frames))
    map_H_ref = map_H_image_of(CAMERA, prior_of(flight, 0).pose, 0.0)
    by_keyframes = ground_rms(flight, (normalized(map_H_ref @ s.ref_H_cur) for s in flight.sightings
                                       if s.ref_H_cur is not None))
    together = ground_rms(flight, (map_H_image_of(CAMERA, one.pose, 0.0) for one in clean(slow)))
    assert together < (0.9 if slow else 0.6) * min(by_sensors, by_keyframes)
    assert together < 0.06


def test_homographies_of_ground_below_the_plane_do_not_lead_astray() -> None:
    """They see the way too short by 1 %: frames and means over frames are better than by the sensors, or as good."""
    flight = reach(followed_m=-0.46)
    by_sensors = [prior_of(flight, k).pose for k in range(len(flight.poses))]
    with_relief, as_a_plane = ([one.pose for one in fused(flight, settings)] for settings in (FusionSettings(), WHITE))
    alone, together = (ground_rms(flight, (map_H_image_of(CAMERA, pose, 0.0) for pose in poses))
                       for poses in (by_sensors, with_relief))
    assert together < 0.75 * alone
    assert mean_error_m(flight, with_relief) < mean_error_m(flight, by_sensors) + 0.01
    assert mean_error_m(flight, with_relief) < 0.5 * mean_error_m(flight, as_a_plane)


def mean_error_m(flight: Reach, poses: list[Pose]) -> float:
    return float(np.linalg.norm(np.mean([error(flight, k, pose)[:2] for k, pose in enumerate(poses)], axis=0)))


@pytest.mark.parametrize("slow", [False, True])
def test_covariance_covers_the_errors(slow: bool) -> None:
    """Mean of the squared Mahalanobis distance of the pose over three flights, which is 6 for exact covariances."""
    distances = []
    for seed in range(1, 4):
        flight = reach(slow, seed)
        for k, one in enumerate(clean(slow, seed)):
            off = error(flight, k, one.pose)
            distances.append(off @ np.linalg.solve(one.covariance, off))
    assert 2 < np.mean(distances) < 9


def test_sensors_alone_place_held_out_points_as_well_as_they_predict() -> None:
    """Pose priors of PPK (2 cm, 0.05 degrees) at 46 m: error over predicted sigma on the ground, its median."""
    ratios = []
    flight = reach()
    for k in range(len(flight.poses)):
        prior = prior_of(flight, k)
        answer = placed(CAMERA, prior.pose, prior.covariance, 0.0, 0.0, {})
        assert isinstance(answer, Placement)
        assert answer.covariance is not None
        chosen, pixels = where_seen(flight.view(k), POINTS)
        J = jacobian(answer.map_H_image, pixels)
        sigma = np.sqrt(np.einsum("nij,jk,nik->n", J, answer.covariance, J))
        off = np.linalg.norm(apply(answer.map_H_image, pixels) - POINTS[chosen, :2], axis=1)
        ratios.append(off / sigma)
    assert 0.7 < np.median(np.concatenate(ratios)) < 1.3


def test_a_wrong_homography_is_said_and_does_no_harm() -> None:
    flight = reach()
    sightings = list(flight.sightings)
    H = sightings[60].ref_H_cur
    assert H is not None
    sightings[60] = replace(sightings[60], ref_H_cur=normalized(shift(40, 0) @ H))  # 2 m
    answers = fused(flight, WHITE, sightings)
    assert "contradict each other" in answers[60].warnings[0]
    assert np.linalg.norm(error(flight, 60, answers[60].pose)[:3]) < 0.1
    assert not any(one.warnings for one in answers[:60] + answers[61:])
    assert np.linalg.norm(answers[65].pose.position_m - clean()[65].pose.position_m) < 0.02


def test_fixes_that_jump_are_said_and_left_out() -> None:
    flight = reach()

    def jumping(k: int) -> PosePrior:
        prior = prior_of(flight, k)
        return replace(prior, pose=turned(prior.pose, np.array([3.0, 0, 0, 0, 0, 0]))) if 60 <= k < 65 else prior

    answers = fused(flight, WHITE, prior=jumping)
    assert all(answers[k].warnings for k in range(60, 65))
    assert not answers[65].warnings
    assert np.linalg.norm(error(flight, 65, answers[65].pose)[:3]) < 0.1


def test_sensors_that_stay_elsewhere_are_followed_after_a_while() -> None:
    flight = reach()

    def moved(k: int) -> PosePrior:
        prior = prior_of(flight, k)
        return replace(prior, pose=turned(prior.pose, np.array([3.0, 0, 0, 0, 0, 0]))) if k >= 60 else prior

    answers = fused(flight, WHITE, prior=moved)
    assert answers[65].warnings
    assert not answers[80].warnings
    assert error(flight, 80, answers[80].pose)[0] == pytest.approx(3, abs=0.2)


def test_lost_frames_are_placed_by_the_sensors_and_a_new_reference_is_taken() -> None:
    flight = reach()
    sightings = list(flight.sightings)
    for k in range(40, 50):
        sightings[k] = replace(sightings[k], ref_H_cur=None, covariance=None)
    at_100 = sightings[100].ref_H_cur
    assert at_100 is not None
    for k in range(100, len(sightings)):  # the tracker takes frame 100 for its reference
        H = sightings[k].ref_H_cur
        assert H is not None
        sightings[k] = replace(sightings[k], ref_H_cur=normalized(np.linalg.inv(at_100) @ H), reset_counter=1)
    for k, one in enumerate(fused(flight, WHITE, sightings)):
        off = error(flight, k, one.pose)
        assert off @ np.linalg.solve(one.covariance, off) < 35
        assert not one.warnings


def test_without_sensors_for_a_while_homographies_carry_on() -> None:
    flight = reach()
    answers = fused(flight, WHITE, prior=lambda k: None if 80 <= k < 110 else prior_of(flight, k))
    for k in (85, 109):
        off = error(flight, k, answers[k].pose)
        assert np.linalg.norm(off[:3]) < 0.15
        assert off @ np.linalg.solve(answers[k].covariance, off) < 35
    assert answers[109].covariance[0, 0] > 1.2 * clean()[109].covariance[0, 0]


def test_control_points_in_some_frames_hold_the_estimate() -> None:
    flight, fusion = reach(slow=True), Fusion(CAMERA, SLOW)
    sure = np.diag([0.005] * 3 + [1e-4] * 3) ** 2
    for k, sighting in itertools.islice(enumerate(flight.sightings), 50):
        seen = (flight.poses[k], sure) if k in {30, 35} else None
        answer = fusion.update(sighting, prior_of(flight, k), seen)
        assert isinstance(answer, Fused)
    assert isinstance(answer, Fused)
    off, alone = error(flight, 49, answer.pose), clean(slow=True)[49]
    assert off @ np.linalg.solve(answer.covariance, off) < 35
    assert np.trace(answer.covariance[:3, :3]) < 0.5 * np.trace(alone.covariance[:3, :3])


def test_what_is_not_known_is_said() -> None:
    flight, fusion = reach(), Fusion(CAMERA)
    first = flight.sightings[0]
    assert fusion.update(first, None) == Unplaced("no pose of the sensors yet")
    unsure = fusion.update(first, replace(prior_of(flight, 0), covariance=None))
    assert isinstance(unsure, Unplaced)
    assert "give position_sigma_m" in unsure.reason
    wrong = fusion.update(first, replace(prior_of(flight, 0), covariance=-np.eye(6)))
    assert isinstance(wrong, Unplaced)
    assert "not positive definite" in wrong.reason
    up = replace(prior_of(flight, 0), pose=Pose.of_angles(np.array([0, 0, 46.0]), 0, -1.5, 0))
    assert fusion.update(first, up) == Unplaced("the camera does not look down on the ground, by its sensors")
    assert fusion.update(first, prior_of(flight, 0), (up.pose, np.eye(6))) == Unplaced(
        "the camera does not look down on the ground, by the control points")
    assert fusion.update(replace(first, ref_H_cur=None), None) == Unplaced(
        "the frame is lost, and the sensors tell nothing of it")


def test_sensors_that_claim_to_be_exact_are_taken() -> None:
    flight = reach()
    fusion = Fusion(CAMERA)
    for k, sighting in enumerate(flight.sightings[:5]):
        exact = replace(prior_of(flight, k), pose=flight.poses[k], covariance=np.zeros((6, 6)))
        answer = fusion.update(sighting, exact)
        assert isinstance(answer, Fused)
        assert np.linalg.norm(error(flight, k, answer.pose)[:3]) < 0.005


def test_four_points_are_a_homography() -> None:
    """Places of a pose give back its homography; their derivatives are those of differences."""
    pose = Pose.of_angles(np.array([12.0, -7, 40]), 0.3, 1.1, 0.05)
    points = PlanePoints.of_view(CAMERA, pose)
    assert points is not None
    placed_at = points.of_pose(pose, 2.0)
    assert placed_at is not None
    c, J = placed_at
    assert np.allclose(points.homography(c), map_H_image_of(CAMERA, pose, 2.0), rtol=1e-9)
    for k, step in enumerate(1e-6 * np.eye(6)):
        after, before = (points.of_pose(turned(pose, sign * step), 2.0) for sign in (1, -1))
        assert after is not None
        assert before is not None
        assert np.allclose((after[0] - before[0]) / 2e-6, J[:, k], atol=1e-5)
    before_H_now = np.array([[1.02, 0.01, 9], [-0.02, 0.99, -40], [1e-5, 2e-5, 1]])
    carried, F = points.carried(c, before_H_now)
    assert np.allclose(points.homography(carried), normalized(points.homography(c) @ before_H_now), rtol=1e-9)
    for k, step in enumerate(1e-4 * np.eye(8)):
        ahead, behind = (points.carried(c + sign * step, before_H_now)[0] for sign in (1, -1))
        assert np.allclose((ahead - behind) / 2e-4, F[:, k], atol=1e-5)


def test_points_stay_below_the_horizon() -> None:
    oblique = Pose.of_angles(np.array([0.0, 0, 20]), 0.0, 0.25, 0)  # the horizon is in the picture
    points = PlanePoints.of_view(CAMERA, oblique)
    assert points is not None
    assert np.isfinite(View(CAMERA, oblique).to_plane(points.pixels, 0.0)).all()
    assert PlanePoints.of_view(CAMERA, Pose.of_angles(np.zeros(3), 0.0, -0.5, 0)) is None
