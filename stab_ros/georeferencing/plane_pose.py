"""The pose of a camera from the homography of a plane (Zhang 2000, section 3.1)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.pose_track import cross_matrix
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

_STEP = 1e-5  # of the logarithm of a focal length

def pose_of_plane(camera: Camera, map_H_image: Homography, plane_m: float) -> Pose:
    """The pose from which a horizontal plane is seen.

    Args:
        camera: of known K.
        map_H_image: (3, 3), of any scale, from undistorted pixels to east and north on the plane, m.
        plane_m: elevation of the plane in the map.

    Returns:
        The pose above the plane; its rotation is the one nearest to what a homography with noise tells.
    """
    columns = _columns(camera, map_H_image)
    R, _ = _nearest_rotation(columns)
    east, north, height = -R.T @ columns[:, 2]
    return Pose(np.array([east, north, plane_m + height]), R)


def pose_derivative(camera: Camera, map_H_image: Homography) -> FloatArray:
    """(6, 8) of `pose_of_plane`, position and rotations about the axes of the map, by h00 .. h21."""
    c = _columns(camera, map_H_image)
    R, S = _nearest_rotation(c)
    entries = np.eye(9)[:8].reshape(8, 3, 3)
    dc = -c @ entries @ np.linalg.inv(map_H_image)  # of the inverse; then its scale is put right
    growth = sum((c[:, k] @ dc[:, :, k].T) / (2 * c[:, k] @ c[:, k]) for k in range(2))
    dc = dc - np.asarray(growth)[:, None, None] * c
    d3 = np.cross(dc[:, :, 0], c[:, 1]) + np.cross(c[:, 0], dc[:, :, 1])
    B = R.T @ np.concatenate([dc[:, :, :2], d3[:, :, None]], axis=2)
    # dR = R [w] with [w] S + S [w] = B - B^T, which is (tr(S) I - S) w for vectors
    skew = np.stack([B[:, 2, 1] - B[:, 1, 2], B[:, 0, 2] - B[:, 2, 0], B[:, 1, 0] - B[:, 0, 1]])
    w = np.linalg.solve(np.trace(S) * np.eye(3) - S, skew)
    place = -cross_matrix(R.T @ c[:, 2]) @ w - R.T @ dc[:, :, 2].T
    return np.concatenate([place, -w])


def focal_derivative(camera: Camera, map_H_image: Homography, plane_m: float) -> FloatArray:
    """(6, 2) of `pose_of_plane`, as `pose_derivative`, by the logarithms of the two focal lengths."""
    columns = []
    for axis in range(2):
        less, more = (pose_of_plane(_zoomed(camera, axis, step), map_H_image, plane_m) for step in (-_STEP, _STEP))
        turn = Rotation.from_matrix(more.cam_R_map.T @ less.cam_R_map).as_rotvec()
        columns.append(np.concatenate([more.position_m - less.position_m, turn]) / (2 * _STEP))
    return np.stack(columns, axis=1)


def _zoomed(camera: Camera, axis: int, change: float) -> Camera:
    K = camera.K.copy()
    K[axis, axis] *= math.exp(change)
    return replace(camera, K=K)


def _columns(camera: Camera, map_H_image: Homography) -> FloatArray:
    """K^-1 image_H_map (3, 3), scaled so that its first columns are of length 1 and the camera is above the plane."""
    columns = np.linalg.solve(camera.K, np.linalg.inv(map_H_image))
    columns /= np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
    return np.asarray(columns * -np.sign(np.cross(columns[:, 0], columns[:, 1]) @ columns[:, 2]))


def _nearest_rotation(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """R (3, 3) and S (3, 3), symmetric, with R S = [c1, c2, c1 x c2]: the polar decomposition."""
    U, singular, Vt = np.linalg.svd(np.column_stack([columns[:, :2], np.cross(columns[:, 0], columns[:, 1])]))
    return np.asarray(U @ Vt), np.asarray(Vt.T * singular @ Vt)
