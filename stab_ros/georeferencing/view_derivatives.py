"""Derivatives of the homography from an image to the water plane: by pose, focal lengths and level.

With A = `View.image_H_map`, H = A^-1 / (A^-1)_22: d(A^-1) = -A^-1 dA A^-1, then the quotient rule.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.pose_track import cross_matrix
from stab_ros.imaging.view import View


def by_pose(view: View, wse_m: float) -> FloatArray:
    """Derivative (8, 6) of h00 .. h21 of map_H_image, h22 = 1, by the pose: 1/m of position, 1/rad of rotations.

    Args:
        view: camera and pose.
        wse_m: water surface elevation in the map.

    Rotations are small, about the axes of the map, as `posed.turned` takes them.
    """
    K, R, offset = view.camera.K, view.pose.cam_R_map, _offset(view, wse_m)
    changes = np.zeros((6, 3, 3))
    changes[:3, :, 2] = -(K @ R).T
    for axis in range(3):
        turning = -R @ cross_matrix(np.eye(3)[axis])
        changes[3 + axis] = K @ np.column_stack([turning[:, :2], turning @ offset])
    return _of_inverse(view.image_H_map(wse_m), changes)


def by_level(view: View, wse_m: float) -> FloatArray:
    """Derivative (8,) of the same by the water surface elevation, 1/m: the opposite of that by the camera's height."""
    return -by_pose(view, wse_m)[:, 2]


def by_focals(view: View, wse_m: float) -> FloatArray:
    """Derivative (8, 2) of the same by the logarithms of both focal lengths."""
    H = view.image_H_map(wse_m)
    rays = np.linalg.solve(view.camera.K, H)
    changes = np.zeros((2, 3, 3))
    for axis in range(2):
        changes[axis, axis] = view.camera.K[axis, axis] * rays[axis]
    return _of_inverse(H, changes)


def _of_inverse(A: FloatArray, changes: FloatArray) -> FloatArray:
    """(8, n) of normalized(inv(A)) by n changes (n, 3, 3) of A."""
    inverse = np.linalg.inv(A)
    changed = -inverse @ changes @ inverse
    scale = inverse[2, 2]
    quotients = changed / scale - changed[:, 2:, 2:] * inverse / scale**2
    return np.asarray(quotients.reshape(-1, 9)[:, :8].T)


def _offset(view: View, wse_m: float) -> FloatArray:
    """From the camera to the origin of the water plane (3,), m."""
    return np.append(-view.pose.position_m[:2], -view.height_m(wse_m))
