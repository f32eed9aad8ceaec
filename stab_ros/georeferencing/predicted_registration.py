"""The homography between two frames as the poses of the sensors predict it, and whether a measured one fits to it.

ref_H_cur = image_H_map(reference) image_H_map(current)^-1 over the ground plane (Hartley and Zisserman 2004, eq. 13.2).
It bounds where a stabiliser need look, and tells a registration to the wrong place from a right one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from stab_ros.core.geometry import apply, jacobian, normalized
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.pose_track import PosePrior
from stab_ros.georeferencing.posed import turned
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.view import View

_STEPS = np.repeat([1e-4, 1e-6], 3)  # m and rad, of the numerical derivatives
_INSET = 0.1  # of the image, from its border to the points at which homographies are compared


@dataclass(frozen=True, eq=False)
class PredictedRegistration:
    """A homography that is expected.

    Attributes:
        ref_H_cur: (3, 3), h22 = 1, from undistorted pixels of the current frame to those of the reference.
        covariance: (8, 8) of h00 .. h21.
    """

    ref_H_cur: Homography
    covariance: FloatArray

    def sigma_px(self, pixels: FloatArray) -> FloatArray:
        """Standard deviation (N,) of where pixels (N, 2) are expected, the longer axis of the ellipse, px."""
        J = jacobian(self.ref_H_cur, pixels)
        return np.asarray(np.sqrt(np.linalg.eigvalsh(J @ self.covariance @ np.swapaxes(J, 1, 2))[:, -1]))


@dataclass(frozen=True)
class Agreement:
    """How a measured homography fits to an expected one.

    Attributes:
        squared_distance: Mahalanobis, of the 8 coordinates of four points: 8 on average if all sigmas are right.
        probability: that it is as large or larger by chance.
        off_px: RMS distance of the points.
    """

    squared_distance: float
    probability: float
    off_px: float


def predict_registration(camera: Camera, reference: PosePrior, current: PosePrior,
                         plane_m: float) -> PredictedRegistration | Unplaced:
    """The homography that two poses predict; their errors are taken for independent.

    Args:
        camera: of known K.
        reference: pose while the reference was taken.
        current: pose while the current frame was taken.
        plane_m: elevation of the ground that homographies follow, in the map.

    Returns:
        The homography, or why there is none, in one line.
    """
    if reference.covariance is None or current.covariance is None:
        return Unplaced("the sensors tell no covariance, give position_sigma_m and attitude_sigma_rad")
    if not min(one.pose.position_m[2] for one in (reference, current)) > plane_m:
        return Unplaced(f"the ground at {plane_m:g} m is not below the camera")

    def between(change: FloatArray) -> Homography:
        ref, cur = (View(camera, turned(one.pose, part)).image_H_map(plane_m) for one, part in
                    ((reference, change[:6]), (current, change[6:])))
        return normalized(ref @ np.linalg.inv(cur))

    steps = np.tile(_STEPS, 2)
    J = np.stack([(between(step) - between(-step)).ravel()[:8] / (2 * size)
                  for step, size in zip(np.diag(steps), steps, strict=True)], axis=1)
    by_reference, by_current = J[:, :6], J[:, 6:]
    covariance = by_reference @ reference.covariance @ by_reference.T + by_current @ current.covariance @ by_current.T
    return PredictedRegistration(between(np.zeros(12)), covariance)


def agreement(predicted: PredictedRegistration, ref_H_cur: Homography, covariance: FloatArray,
              size: tuple[int, int]) -> Agreement:
    """Compares a measured homography with the predicted one at four points of the frame.

    Args:
        predicted: by the sensors.
        ref_H_cur: (3, 3), measured.
        covariance: (8, 8) of its h00 .. h21.
        size: width and height of the frame, px.
    """
    shares = np.array([[_INSET, _INSET], [1 - _INSET, _INSET], [1 - _INSET, 1 - _INSET], [_INSET, 1 - _INSET]])
    points = shares * (np.array(size) - 1)
    off = (apply(ref_H_cur, points) - apply(predicted.ref_H_cur, points)).ravel()
    J = jacobian(predicted.ref_H_cur, points).reshape(8, 8)
    squared = float(off @ np.linalg.solve(J @ (predicted.covariance + covariance) @ J.T, off))
    return Agreement(squared, float(chdtrc(8, squared)), float(np.sqrt(np.mean(off**2) * 2)))
