"""Derivatives of places and poses against differences."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.plane_pose import pose_derivative, pose_of_plane
from stab_ros.georeferencing.posed import map_H_image_of, turned
from stab_ros.georeferencing.view_derivatives import by_focals, by_level, by_pose
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

CAMERA = Camera(np.array([[1500.0, 0, 963.2], [0, 1450, 535.1], [0, 0, 1]]), np.zeros(5), "plumb_bob", (1920, 1080))
WSE_M = 3.4


def view(pitch_deg: float) -> View:
    return View(CAMERA, Pose.of_angles(np.array([12.0, -31.0, 49.0]), 2.1, math.radians(pitch_deg), 0.05))


def differences(of: Callable[[FloatArray], FloatArray], steps: FloatArray) -> FloatArray:
    """Central ones, (m, n), of a function of (n,) at 0."""
    return np.stack([(of(step) - of(-step)) / (2 * step.sum()) for step in np.diag(steps)], axis=1)


def entries(camera: Camera, pose: Pose, wse_m: float = WSE_M) -> FloatArray:
    return np.asarray(map_H_image_of(camera, pose, wse_m).ravel()[:8])


def agree(exact: FloatArray, differences_: FloatArray) -> bool:
    return bool(np.all(np.abs(exact - differences_) <= 1e-6 * np.abs(differences_).max(axis=1, keepdims=True)))


@pytest.mark.parametrize("pitch_deg", [15, 60, 90])
def test_derivatives_of_the_homography_are_those_of_differences(pitch_deg: float) -> None:
    at = view(pitch_deg)
    steps = np.repeat([1e-3, 1e-5], 3)
    assert agree(by_pose(at, WSE_M), differences(lambda x: entries(CAMERA, turned(at.pose, x)), steps))
    assert agree(by_level(at, WSE_M)[:, None],
                 differences(lambda x: entries(CAMERA, at.pose, WSE_M + float(x[0])), np.array([1e-3])))

    def zoomed(x: FloatArray) -> FloatArray:
        return entries(replace(CAMERA, K=np.diag([*np.exp(x), 1]) @ (CAMERA.K - MIDDLE) + MIDDLE), at.pose)
    assert agree(by_focals(at, WSE_M), differences(zoomed, np.full(2, 1e-5)))


SCALES = np.array([0.03, 0.03, 30, 0.03, 0.03, 30, 1e-4, 1e-4])  # of entries of map_H_image
MIDDLE = np.zeros((3, 3))
MIDDLE[:2, 2] = CAMERA.K[:2, 2]


@pytest.mark.parametrize("pitch_deg", [15, 60, 90])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_the_covariance_of_a_pose_by_its_plane_is_that_of_differences(pitch_deg: float, noise: float) -> None:
    """Also of a homography that no pose has exactly."""
    rng = np.random.default_rng(2)
    H = map_H_image_of(CAMERA, view(pitch_deg).pose, WSE_M)
    H.ravel()[:8] *= 1 + noise * rng.standard_normal(8)
    pose = pose_of_plane(CAMERA, H, WSE_M)

    def change(x: FloatArray) -> FloatArray:
        after = pose_of_plane(CAMERA, H + np.append(x, 0).reshape(3, 3), WSE_M)
        turn = after.cam_R_map.T @ pose.cam_R_map
        return np.append(after.position_m - pose.position_m, [turn[2, 1], turn[0, 2], turn[1, 0]])

    J = differences(change, 1e-6 * SCALES)
    A = rng.standard_normal((8, 8)) * SCALES[:, None]
    ours = pose_derivative(CAMERA, H)
    expected, found = J @ A @ A.T @ J.T, ours @ A @ A.T @ ours.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.all(np.abs(found - expected) < 1e-4 * scale)
