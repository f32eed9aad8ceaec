"""The tilt of a reference that is taken for nadir, from the homographies of the frames after it.

A homography of the ground, K (R - t n^T / d) K^-1, takes two directions on the ground, which are perpendicular and of
one length, to two in the frame that are so as well (Malis and Vargas 2007; self-calibration of a plane, Triggs 1998,
eq. 4). Their disagreement for n straight down tells the tilt as soon as the camera moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from stab_ros.core.types import FloatArray, Homography

_LEAST_FRAMES = 10
_STEP_RAD = 1e-5  # of the numerical derivatives
_MOST_SIGMAS, _LEAST_RAD = 4.0, math.radians(1)  # of a tilt that is warned of
_LOOSE_RAD = math.radians(10)  # uncertainty above which nothing is known


@dataclass
class TiltEstimate:
    """Gathers frames. K: (3, 3), of the camera."""

    K: FloatArray
    frames: int = 0
    _normal: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    _right: FloatArray = field(default_factory=lambda: np.zeros(2))
    _square: float = 0.0

    def add(self, ref_H_cur: Homography, covariance: FloatArray) -> None:
        """Takes the homography (3, 3) of a frame, h22 = 1, and its covariance (8, 8)."""
        residual = self._constraints(ref_H_cur, 0.0, 0.0)
        J = np.column_stack([self._constraints(ref_H_cur, _STEP_RAD, 0.0) - residual,
                             self._constraints(ref_H_cur, 0.0, _STEP_RAD) - residual]) / _STEP_RAD
        by_H = self._by_entries(ref_H_cur, covariance)
        C = by_H @ by_H.T
        if np.linalg.cond(C) > 1e12:
            return  # the reference itself
        information = np.linalg.inv(C)
        self._normal += J.T @ information @ J
        self._right -= J.T @ information @ residual
        self._square += float(residual @ information @ residual)
        self.frames += 1

    @property
    def tilt_rad(self) -> tuple[float, float] | None:
        """The tilt and its standard deviation; None: the camera has not moved enough to tell."""
        if self.frames < _LEAST_FRAMES or np.linalg.cond(self._normal) > 1e12:
            return None
        C = np.linalg.inv(self._normal)
        about = C @ self._right
        factor = max(1.0, (self._square - float(about @ self._right)) / (2 * self.frames - 2))
        sigma = math.sqrt(factor * float(np.linalg.eigvalsh(C)[-1]))
        return (float(np.linalg.norm(about)), sigma) if sigma < _LOOSE_RAD else None

    @property
    def doubt(self) -> str:
        """Why the reference is no nadir view: one line; "" where the homographies do not contradict it."""
        found = self.tilt_rad
        if found is None or found[0] < max(_LEAST_RAD, _MOST_SIGMAS * found[1]):
            return ""
        tilt, sigma = (math.degrees(angle) for angle in found)
        return (f"the homographies contradict a reference that looks straight down: it is tilted by {tilt:.1f} +- "
                f"{sigma:.1f} degrees")

    def _constraints(self, ref_H_cur: Homography, about_x: float, about_y: float) -> FloatArray:
        """Cosine of two perpendicular directions on the ground, and relative difference of their squared lengths."""
        M = np.linalg.solve(self.K, np.linalg.inv(ref_H_cur)) @ self.K
        (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (about_x, about_y))
        plane = np.array([[cy, sx * sy], [0, cx], [-sy, sx * cy]])  # Ry Rx of the first two axes
        first, second = (M @ plane).T
        scale = np.linalg.norm(first) * np.linalg.norm(second)
        return np.asarray(np.array([first @ second, (first @ first - second @ second) / 2]) / scale)

    def _by_entries(self, H: Homography, covariance: FloatArray) -> FloatArray:
        """(2, 8), such that its product with its transpose is the covariance of the constraints."""
        steps = 1e-3 * np.linalg.cholesky(covariance + 1e-15 * np.diag(np.diag(covariance)) + 1e-30 * np.eye(8)).T
        return np.stack([(self._constraints(_moved(H, step), 0, 0) - self._constraints(_moved(H, -step), 0, 0)) / 2e-3
                         for step in steps], axis=1)


def _moved(H: Homography, step: FloatArray) -> Homography:
    return np.asarray(H + np.append(step, 0).reshape(3, 3))
