"""Verification points on what is fixed to the camera: dirt on the lens, an overlay. They say nothing of the ground.

Where a homography is known, it says where in the stabilised picture a place of the camera lies. If the windows of
the reference are found again there, and not where the ground should be, then what they show moves with the camera.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray
from stab_ros.metrics.overlap import windows_inside

MOVED_PX = 3.0  # of the camera, from which on a place of the camera is told from a place of the ground
_NEAR_PX = 9  # side of the part of a window that is compared
_MATCHES = 0.6  # correlation with the reference at the place of the camera
_BETTER = 0.2  # than at the place of the ground
_LEAST_CONTRAST, _LEAST_TO_NOISE = 3.0, 2.0  # standard deviation of such a part, grey levels and ratio to the noise
_LEAST_SHARE = 0.02  # of a window: a speck; without one it is 0
_MIN_VOTES, _MOST = 4, 0.5  # a point is fixed to the camera from so many frames and this share of them on


class CameraFixed:
    """Classifies P verification points by votes over the frames in which the camera has moved."""

    def __init__(self, reference: Gray, windows: FloatArray, centres_px: IdArray, noise_sigma: float) -> None:
        """reference: (h, w) uint8. windows: (P, N, N) of it. centres_px: (P, 2). noise_sigma: of it, grey levels."""
        self._reference = reference
        self._windows = np.asarray(windows, np.float32)
        self._centres = np.asarray(centres_px, np.int64)
        self._contrast = max(_LEAST_CONTRAST, _LEAST_TO_NOISE * noise_sigma)
        self._seen = np.zeros(len(centres_px), np.int64)
        self._found = np.zeros(len(centres_px), np.int64)

    @property
    def fixed(self) -> BoolArray:
        """(P,) bool: points on something that moves with the camera."""
        return np.asarray((self._found >= _MIN_VOTES) & (self._found >= _MOST * self._seen))

    def vote(self, gray: Gray, valid: BoolArray, windows: FloatArray, fixed_H_ref: Homography) -> BoolArray:
        """Adds the votes of one frame, and returns the points (P,) bool that are disturbed in it.

        Once something fixed to the camera has been found, that is wherever it has moved to in this frame.

        Args:
            gray: (h, w) uint8, stabilised.
            valid: (h, w) bool, its overlap with the reference.
            windows: (P, N, N), its windows at the points.
            fixed_H_ref: (3, 3), from a place in the reference to that in `gray` where the same pixel of the camera is.
        """
        disturbed = np.zeros(len(self._centres), bool)
        for point in self._told_apart(valid, fixed_H_ref):
            now, reference = np.asarray(windows[point], np.float32), self._windows[point]
            gone = self._share(reference, self._window(gray, point, fixed_H_ref), now)
            come = self._share(now, self._window(self._reference, point, np.linalg.inv(fixed_H_ref)), reference)
            self._seen[point] += 1
            self._found[point] += gone >= _LEAST_SHARE
            disturbed[point] = max(gone, come) >= _LEAST_SHARE
        return disturbed if self.fixed.any() else np.zeros_like(disturbed)

    def _told_apart(self, valid: BoolArray, fixed_H_ref: Homography) -> Sequence[int]:
        """Points whose place of the camera has moved away, and can be seen."""
        places = apply(fixed_H_ref, self._centres.astype(np.float64))
        away = np.hypot(*(places - self._centres).T) > MOVED_PX
        seen = windows_inside(valid, np.round(places).astype(np.int64), self._windows.shape[1])
        found: Sequence[int] = np.flatnonzero(away & seen).tolist()
        return found

    def _window(self, image: Gray, point: int, image_H_here: Homography) -> FloatArray:
        return _window_at(image, self._centres[point], self._windows.shape[1], image_H_here)

    def _share(self, window: FloatArray, camera: FloatArray, ground: FloatArray) -> float:
        """Share of a window that is found again at the place of the camera, and only there."""
        at_camera, contrast = _correlation(window, camera)
        at_ground, _ = _correlation(window, ground)
        return float(np.mean((at_camera > _MATCHES) & (at_camera > at_ground + _BETTER) & (contrast > self._contrast)))


def in_place(reference_px: FloatArray, current_px: FloatArray, fixed_H_ref: Homography, gate_px: float) -> BoolArray:
    """(n,) bool: points, (n, 2) each, that stay where they are in the camera, although the camera has moved."""
    places = apply(fixed_H_ref, reference_px)
    moved = np.hypot(*(places - reference_px).T) > MOVED_PX
    return np.asarray(moved & (np.hypot(*(places - current_px).T) < gate_px))


def _window_at(image: Gray, centre: IdArray, side: int, image_H_here: Homography) -> FloatArray:
    """(N, N) float32: what the pixels of a window show where `image_H_here` has them in `image`."""
    span = np.arange(-(side // 2), side // 2 + 1, dtype=np.float64)
    places = np.stack(np.meshgrid(span + centre[0], span + centre[1]), axis=-1).reshape(-1, 2)
    x, y = apply(image_H_here, places).reshape(side, side, 2).transpose(2, 0, 1).astype(np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR), np.float32)


def _correlation(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, N) each: correlation of two windows in a small square about every pixel, and the contrast of `a` there."""
    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(cv2.blur(values, (_NEAR_PX, _NEAR_PX)))

    mean_a, mean_b = mean(a), mean(b)
    variance_a, variance_b = (np.maximum(mean(x * x) - m * m, 0) for x, m in ((a, mean_a), (b, mean_b)))
    covariance = mean(a * b) - mean_a * mean_b
    return np.asarray(covariance / np.sqrt(np.maximum(variance_a * variance_b, 1.0))), np.sqrt(variance_a)
