"""What frames placed by followed control points share: errors of marks and survey, which displacements do not have."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stab_ros.core.geometry import apply, jacobian
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.followed_error import followed_error
from stab_ros.georeferencing.place_error import PlaceError, all_shared
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

CAMERA = Camera(np.array([[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]]), np.zeros(0), "plumb_bob", (1920, 1080))
MAP_M = np.array([[-20.0, -8, 0], [18, -10, 2], [19, 10, 1], [-21, 9, 3], [0, -11, 0], [-8, 5, 2], [9, 2, 0],
                  [2, 11, 1]])
MARK_PX, SURVEY_M, TRACK_PX = 0.5, 0.02, 0.05
PLACE_PX = np.array([[700.0, 600]])
ALL, SOME = np.ones(8, bool), np.array([1, 1, 1, 1, 0, 1, 0, 1], bool)


def view(frame: int) -> View:
    sway = 0.3 * np.array([math.sin(frame), math.cos(frame), 0.5 * math.sin(2 * frame)])
    return View(CAMERA, Pose.of_angles(np.array([0, -26.0, 46]) + sway, 1.57 + 0.01 * frame, 1.05, 0.01 * frame))


def fitted(frame: int, seen: BoolArray, marks_px: FloatArray, survey_m: FloatArray, rng: np.random.Generator,
           near: View | None, track_px: float) -> CameraFit:
    pixels = view(frame).project(MAP_M) + marks_px + rng.normal(0, 1, (8, 2)) * track_px
    points = ControlPoints(tuple("abcdefgh"), pixels, MAP_M + survey_m).where(seen)
    noise = PointNoise(MARK_PX, SURVEY_M)
    if near is None:
        return fit_camera(points, CAMERA.size, noise=noise)
    return fit_pose(points, near.camera, noise=noise, near=near)


def error_and_variance(seed: int, seen: BoolArray, calibrated: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Error (2,) of the displacement of a place between two frames; its variance (2,), and that with nothing shared."""
    rng = np.random.default_rng(seed)
    marks_px, survey_m = rng.normal(0, MARK_PX, (8, 2)), rng.normal(0, SURVEY_M, (8, 3))
    first = fitted(0, ALL, marks_px, survey_m, rng, view(0) if calibrated else None, 0.0)
    fit = fitted(1, seen, marks_px, survey_m, rng, first.view, TRACK_PX)
    tracking = np.broadcast_to(TRACK_PX**2 * np.eye(2), (8, 2, 2))
    errors = [all_shared(first.spread_on(0.0)[1]),
              followed_error(first, fit, seen, tracking[seen]).on_water(0.0)]
    off, change, own, alone = np.zeros(2), np.zeros((2, errors[0].shared.shape[1])), np.zeros(2), np.zeros(2)
    for sign, one, at, error in zip((-1, 1), (first, fit), (view(0), view(1)), errors, strict=True):
        H = one.map_H_image(0.0)[0]
        J = jacobian(H, PLACE_PX)[0]
        off += sign * (apply(H, PLACE_PX) - at.to_plane(PLACE_PX, 0.0))[0]
        change += sign * J @ error.shared
        own += np.diag(J @ error.own @ J.T)
        alone += np.diag(J @ error.covariance @ J.T)
    return off, own + np.sum(change**2, axis=1), alone


@pytest.mark.parametrize(("seen", "calibrated"), [(ALL, True), (SOME, True), (ALL, False)])
def test_displacements_are_as_sure_as_said(seen: BoolArray, calibrated: bool) -> None:
    drawn = [error_and_variance(seed, seen, calibrated) for seed in range(60)]
    off, variance, alone = (np.array(column) for column in zip(*drawn, strict=True))
    assert np.sqrt(np.mean(off**2 / variance)) == pytest.approx(1.0, abs=0.15)
    assert np.mean(alone) > (3 if seen is SOME else 20) * np.mean(variance)


def test_of_one_view_all_but_tracking_is_shared() -> None:
    rng = np.random.default_rng(1)
    first = fitted(0, ALL, np.zeros((8, 2)), np.zeros((8, 3)), rng, view(0), 0.0)
    error: PlaceError = followed_error(first, first, ALL, np.zeros((8, 2, 2))).on_water(0.5)
    scale = np.sqrt(np.diag(error.covariance))
    assert np.abs(error.own / np.outer(scale, scale)).max() < 1e-9
    whole = first.map_H_image(0.5)[1]
    np.testing.assert_allclose(error.covariance / np.outer(scale, scale), whole / np.outer(scale, scale), atol=1e-9)
