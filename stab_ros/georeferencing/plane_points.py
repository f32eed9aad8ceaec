"""A homography as the places of four image points on the plane: 8 numbers in metres, well scaled and with a covariance.

A homography is given by four points (Hartley and Zisserman 2004, section 4.1). In this form that of a pose, that of the
stabiliser and the errors of both are compared where they count: on the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply, jacobian, normalized, point_jacobian
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.pose_track import cross_matrix
from stab_ros.georeferencing.small_matrices import inverse, solved
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

_INSET = 0.1  # of the image, from its border to the points
_STEEP = 0.17  # sine of the angle below the horizon from which on the ground is near enough to count


@dataclass(frozen=True, eq=False)
class PlanePoints:
    """Four points of an image, undistorted pixels (4, 2), and their rays (4, 3) in the camera's axes."""

    pixels: FloatArray
    rays: FloatArray

    @staticmethod
    def of_view(camera: Camera, pose: Pose) -> PlanePoints | None:
        """Near the corners of the image, or lower where those are too near to the horizon; None: all are."""
        (width, height), k_inv = camera.size, inverse(camera.K)
        for top in (_INSET, 0.3, 0.5, 0.7):
            shares = np.array([[_INSET, top], [1 - _INSET, top], [1 - _INSET, 1 - _INSET], [_INSET, 1 - _INSET]])
            pixels = shares * [width - 1, height - 1]
            rays = np.column_stack([pixels, np.ones(4)]) @ k_inv.T
            down = (rays @ pose.cam_R_map)[:, 2] / np.linalg.norm(rays, axis=1)
            if (down < -_STEEP).all():
                return PlanePoints(pixels, rays)
        return None

    def of_pose(self, pose: Pose, plane_m: float) -> tuple[FloatArray, FloatArray] | None:
        """Places (8,) of the points as seen from a pose, and their derivative (8, 6) by it; None above the horizon.

        plane_m: elevation of the plane. The derivative is by position and rotations about the axes of the map.
        """
        d = self.rays @ pose.cam_R_map
        if not (pose.position_m[2] > plane_m and (d[:, 2] < 0).all()):
            return None
        s = (plane_m - pose.position_m[2]) / d[:, 2]
        J = np.zeros((4, 2, 6))
        J[:, 0, 0] = J[:, 1, 1] = 1
        J[:, :, 2] = -d[:, :2] / d[:, 2:]
        J[:, :, 3:] = s[:, None, None] * J[:, :, :3] @ np.stack([-cross_matrix(one) for one in d])
        return (pose.position_m[:2] + s[:, None] * d[:, :2]).ravel(), J.reshape(8, 6)

    def homography(self, places_m: FloatArray) -> Homography:
        """map_H_image (3, 3), h22 = 1, that has the points at `places_m` (8,)."""
        p, q = self.pixels, places_m.reshape(4, 2)
        to_unit = np.diag([1 / np.ptp(p[:, 0]), 1 / np.ptp(p[:, 1]), 1.0])  # for the condition of the equations
        u, middle = p @ to_unit[:2, :2], q.mean(axis=0)
        v = q - middle
        ones = np.column_stack([u, np.ones(4)])
        A = np.zeros((8, 8))
        A[0::2, 0:3] = A[1::2, 3:6] = ones
        A[:, 6:] = -v.reshape(8, 1) * np.repeat(u, 2, axis=0)
        H = np.append(solved(A, v.ravel()), 1.0).reshape(3, 3) @ to_unit
        H[:2] += np.outer(middle, H[2])
        return normalized(H)

    def carried(self, places_m: FloatArray, before_H_now: Homography) -> tuple[FloatArray, FloatArray]:
        """Places (8,) of the points in a later frame, and their derivative (8, 8) by those in an earlier one."""
        H, seen_before = self.homography(places_m), apply(before_H_now, self.pixels)
        F = solved(jacobian(H, self.pixels).reshape(8, 8).T, jacobian(H, seen_before).reshape(8, 8).T).T
        return apply(H, seen_before).ravel(), F

    def covariance(self, places_m: FloatArray, ref_H_cur: Homography, covariance: FloatArray) -> FloatArray:
        """Covariance (8, 8) of the places, m^2, from that of h00 .. h21 of ref_H_cur."""
        map_H_ref = normalized(self.homography(places_m) @ inverse(ref_H_cur))
        in_reference = apply(ref_H_cur, self.pixels)
        J = (point_jacobian(map_H_ref, in_reference) @ jacobian(ref_H_cur, self.pixels)).reshape(8, 8)
        return np.asarray(J @ covariance @ J.T)

    def blurred(self, places_m: FloatArray, sigma_px: float) -> FloatArray:
        """Covariance (8, 8) of the places, m^2, of independent errors of the pixels."""
        out, J = np.zeros((8, 8)), point_jacobian(self.homography(places_m), self.pixels)
        for k in range(4):
            out[2 * k:2 * k + 2, 2 * k:2 * k + 2] = sigma_px**2 * J[k] @ J[k].T
        return out
