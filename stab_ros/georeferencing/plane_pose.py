"""The pose of a camera from the homography of a plane (Zhang 2000, section 3.1)."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray, Homography
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

_STEP = 1e-6  # of the numerical derivative, relative


def pose_of_plane(camera: Camera, map_H_image: Homography, plane_m: float) -> Pose:
    """The pose from which a horizontal plane is seen.

    Args:
        camera: of known K.
        map_H_image: (3, 3), of any scale, from undistorted pixels to east and north on the plane, m.
        plane_m: elevation of the plane in the map.

    Returns:
        The pose above the plane; its rotation is the one nearest to what a homography with noise tells.
    """
    columns = np.linalg.solve(camera.K, np.linalg.inv(map_H_image))
    columns /= np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
    r3 = np.cross(columns[:, 0], columns[:, 1])
    columns *= -np.sign(r3 @ columns[:, 2])  # the camera is above the plane
    U, _, Vt = np.linalg.svd(np.column_stack([columns[:, :2], r3]))
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    east, north, height = -R.T @ columns[:, 2]
    return Pose(np.array([east, north, plane_m + height]), R)


def pose_covariance(camera: Camera, map_H_image: Homography, covariance: FloatArray, plane_m: float) -> FloatArray:
    """Covariance (6, 6) of `pose_of_plane`, as of `Placement`.

    Args:
        camera: as there.
        map_H_image: as there, with h22 = 1.
        covariance: (8, 8) of its h00 .. h21.
        plane_m: as there.
    """
    steps = _STEP * np.sqrt(np.maximum(np.diag(covariance), 1e-24))
    J = np.stack([(_change(camera, map_H_image, k, step, plane_m) - _change(camera, map_H_image, k, -step, plane_m))
                  / (2 * step) for k, step in enumerate(steps)], axis=1)
    return np.asarray(J @ covariance @ J.T)


def _change(camera: Camera, H: Homography, entry: int, step: float, plane_m: float) -> FloatArray:
    """(6,) change of the pose with that of one entry of H."""
    changed = H.copy()
    changed.flat[entry] += step
    before, after = pose_of_plane(camera, H, plane_m), pose_of_plane(camera, changed, plane_m)
    turn = after.cam_R_map.T @ before.cam_R_map
    return np.concatenate([after.position_m - before.position_m,
                           np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2])
