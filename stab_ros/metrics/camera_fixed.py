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
_MIN_VOTES, _MOST = 2, 0.25  # a point is fixed to the camera from so many frames and this share of them on


class CameraFixed:
    """Classifies P verification points by votes over the frames in which the camera has moved."""

    def __init__(self, windows: FloatArray, centres_px: IdArray, noise_sigma: float) -> None:
        """windows: (P, N, N) of the reference. centres_px: (P, 2). noise_sigma: of the reference, grey levels."""
        self._windows = np.asarray(windows, np.float32)
        self._centres = np.asarray(centres_px, np.int64)
        self._contrast = max(_LEAST_CONTRAST, _LEAST_TO_NOISE * noise_sigma)
        self._seen = np.zeros(len(centres_px), np.int64)
        self._found = np.zeros(len(centres_px), np.int64)

    @property
    def fixed(self) -> BoolArray:
        """(P,) bool: points on something that moves with the camera."""
        return np.asarray((self._found >= _MIN_VOTES) & (self._found >= _MOST * self._seen))

    def vote(self, gray: Gray, valid: BoolArray, windows: FloatArray, fixed_H_ref: Homography) -> None:
        """Adds the votes of one frame.

        Args:
            gray: (h, w) uint8, stabilised.
            valid: (h, w) bool, its overlap with the reference.
            windows: (P, N, N), its windows at the points.
            fixed_H_ref: (3, 3), from a place in the reference to that in `gray` where the same pixel of the camera is.
        """
        for point in self._told_apart(valid, fixed_H_ref):
            ours = _window_at(gray, self._centres[point], self._windows.shape[1], fixed_H_ref)
            self._seen[point] += 1
            self._found[point] += self._share(point, ours, np.asarray(windows[point], np.float32)) >= _LEAST_SHARE

    def _told_apart(self, valid: BoolArray, fixed_H_ref: Homography) -> Sequence[int]:
        """Points whose place of the camera has moved away, and can be seen."""
        places = apply(fixed_H_ref, self._centres.astype(np.float64))
        away = np.hypot(*(places - self._centres).T) > MOVED_PX
        seen = windows_inside(valid, np.round(places).astype(np.int64), self._windows.shape[1])
        found: Sequence[int] = np.flatnonzero(away & seen).tolist()
        return found

    def _share(self, point: int, camera: FloatArray, ground: FloatArray) -> float:
        """Share of the window of a point that is found again at the place of the camera, and only there."""
        reference = self._windows[point]
        at_camera, contrast = _correlation(reference, camera)
        at_ground, _ = _correlation(reference, ground)
        return float(np.mean((at_camera > _MATCHES) & (at_camera > at_ground + _BETTER) & (contrast > self._contrast)))


def in_place(reference_px: FloatArray, current_px: FloatArray, fixed_H_ref: Homography, gate_px: float) -> BoolArray:
    """(n,) bool: points, (n, 2) each, that stay where they are in the camera, although the camera has moved."""
    places = apply(fixed_H_ref, reference_px)
    moved = np.hypot(*(places - reference_px).T) > MOVED_PX
    return np.asarray(moved & (np.hypot(*(places - current_px).T) < gate_px))


def _window_at(gray: Gray, centre: IdArray, side: int, fixed_H_ref: Homography) -> FloatArray:
    """(N, N) float32: what the pixels of a window of the reference show in `gray`."""
    span = np.arange(-(side // 2), side // 2 + 1, dtype=np.float64)
    places = np.stack(np.meshgrid(span + centre[0], span + centre[1]), axis=-1).reshape(-1, 2)
    x, y = apply(fixed_H_ref, places).reshape(side, side, 2).transpose(2, 0, 1).astype(np.float32)
    return np.asarray(cv2.remap(gray, x, y, cv2.INTER_LINEAR), np.float32)


def _correlation(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, N) each: correlation of two windows in a small square about every pixel, and the contrast of `a` there."""
    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(cv2.blur(values, (_NEAR_PX, _NEAR_PX)))

    mean_a, mean_b = mean(a), mean(b)
    variance_a, variance_b = (np.maximum(mean(x * x) - m * m, 0) for x, m in ((a, mean_a), (b, mean_b)))
    covariance = mean(a * b) - mean_a * mean_b
    return np.asarray(covariance / np.sqrt(np.maximum(variance_a * variance_b, 1.0))), np.sqrt(variance_a)
