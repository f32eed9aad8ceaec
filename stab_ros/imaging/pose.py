"""Where a camera is and where it looks.

The map's axes are x east, y north, z up, m (REP-103 and REP-105); the camera's are x right, y down, z along the view
(the optical frame of REP-103). Angles are those of the third paper and of ImGRAFT: the yaw of the view is 0 to the east
and pi/2 to the north, the pitch is positive downwards and pi/2 at nadir, the roll turns about the view axis. At nadir
with yaw 0 the top of the image is east, its right side south.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray

_GIMBAL_LOCK = 1e-9  # cosine of the pitch below which yaw and roll turn about the same axis
BODY_R_OPTICAL: FloatArray = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # x forward, y left, z up (REP-103)
BODY_R_OPTICAL.flags.writeable = False


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and attitude of a camera in the map.

    Attributes:
        position_m: (3,) float64, of the projection centre.
        cam_R_map: (3, 3) float64, rotation from the axes of the map to those of the camera.

    Raises:
        InputError: not finite, or not a rotation.
    """

    position_m: FloatArray
    cam_R_map: FloatArray

    def __post_init__(self) -> None:
        if self.position_m.shape != (3,) or self.cam_R_map.shape != (3, 3):
            raise InputError("a pose must be a position of 3 numbers and a rotation of 3x3")
        if not (np.isfinite(self.position_m).all() and np.isfinite(self.cam_R_map).all()):
            raise InputError("the position and the rotation of a pose must be finite")
        R = self.cam_R_map
        if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
            raise InputError("the rotation of a pose must be orthonormal and right-handed")

    @staticmethod
    def of_angles(position_m: FloatArray, yaw_rad: float, pitch_rad: float, roll_rad: float) -> Pose:
        """The pose of these angles."""
        return Pose(np.asarray(position_m, float), rotation_of(yaw_rad, pitch_rad, roll_rad))

    @staticmethod
    def of_quaternion(position_m: FloatArray, map_q_optical: FloatArray) -> Pose:
        """The pose of a quaternion x, y, z, w from the optical frame to the map, as in geometry_msgs.

        Raises:
            InputError: its length is not 1 within 1 %.
        """
        return Pose(np.asarray(position_m, float), rotation_of_quaternion(map_q_optical).T)

    @property
    def angles_rad(self) -> tuple[float, float, float]:
        """Yaw in (-pi, pi], pitch in [-pi/2, pi/2] and roll in (-pi, pi]; at nadir and zenith the roll is 0."""
        return angles_of(self.cam_R_map)

    @property
    def map_q_optical(self) -> FloatArray:
        """Quaternion x, y, z, w, w >= 0, from the optical frame to the map, as in geometry_msgs."""
        return quaternion_of(self.cam_R_map.T)

    def to_camera(self, points_m: FloatArray) -> FloatArray:
        """Points (N, 3) of the map in the camera's axes, (N, 3), m."""
        return np.asarray((points_m - self.position_m) @ self.cam_R_map.T)


def rotation_of(yaw_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """cam_R_map (3, 3) of the angles (ImGRAFT's camera.m: Messerli and Grinsted 2015)."""
    c1, c2, c3 = math.cos(yaw_rad), math.cos(pitch_rad), math.cos(roll_rad)
    s1, s2, s3 = math.sin(yaw_rad), math.sin(pitch_rad), math.sin(roll_rad)
    return np.array([
        [c3 * s1 - s3 * s2 * c1, -s3 * s2 * s1 - c3 * c1, -s3 * c2],
        [-c3 * s2 * c1 - s3 * s1, s3 * c1 - c3 * s2 * s1, -c3 * c2],
        [c2 * c1, c2 * s1, -s2],
    ])


def angles_of(cam_R_map: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch and roll of a rotation, as `Pose.angles_rad`."""
    R = cam_R_map
    cos_pitch = math.hypot(R[2, 0], R[2, 1])
    pitch = math.atan2(-R[2, 2], cos_pitch)
    if cos_pitch > _GIMBAL_LOCK:
        return math.atan2(R[2, 1], R[2, 0]), pitch, math.atan2(-R[0, 2], -R[1, 2])
    return math.atan2(R[0, 0], -R[0, 1]), pitch, 0.0


def rotation_of_quaternion(q: FloatArray) -> FloatArray:
    """Rotation (3, 3) of a quaternion x, y, z, w.

    Raises:
        InputError: its length is not 1 within 1 %.
    """
    length = float(np.linalg.norm(q))
    if not abs(length - 1) < 0.01:
        raise InputError(f"a quaternion of length {length:g}, it must be 1")
    x, y, z, w = np.asarray(q, float) / length
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def quaternion_of(R: FloatArray) -> FloatArray:
    """Quaternion x, y, z, w, w >= 0, of a rotation (3, 3), as the eigenvector of Bar-Itzhack (2000), eq. 15."""
    K = np.array([
        [R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
        [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
        [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
        [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]],
    ])
    q = np.linalg.eigh(K)[1][:, -1]
    return np.asarray(q if q[3] >= 0 else -q)
