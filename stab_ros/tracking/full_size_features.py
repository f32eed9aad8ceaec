"""Relocation by features at full size: where small pictures hold no texture, as of fine gravel.

ORB key points (Rublee et al. 2011; a tenth of the time of SIFT) of a window of at most `_WINDOW_PX` pixels, so that the
cost does not grow with the size of the image. The window lies where static ground was seen last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray, Image
from stab_ros.tracking import agreement

_WINDOW_PX = 960 * 540
_DETECTED, _FEATURES = 8000, 2000  # key points detected, and kept, spread evenly
_CELLS = 12  # along a side of the window
_LEVELS, _LEVEL_RATIO = 4, 1.2
_FAST_THRESHOLD = 5
_RATIO = 0.85  # of the nearest to the second nearest descriptor
_THRESHOLD_PX = 4.0
_LEAST = 6


@dataclass(frozen=True, eq=False)
class FullSizeFeatures:
    """Key points of a window.

    centre_px: (2,), around which it was asked for. px: (N, 2) in the image. descriptor: (N, 32) uint8.
    """

    NEAR_PX: ClassVar[float] = 64.0  # windows whose centres are closer show the same

    centre_px: FloatArray
    px: FloatArray
    descriptor: Image

    @staticmethod
    def of(gray: Gray, centre_px: FloatArray) -> FullSizeFeatures:
        """Those of the window around a point (2,), which is moved into the image, (h, w) uint8."""
        width, height, left, top = _window(gray.shape, centre_px)
        window = np.ascontiguousarray(gray[top : top + height, left : left + width])
        orb = cv2.ORB.create(_DETECTED, _LEVEL_RATIO, _LEVELS, fastThreshold=_FAST_THRESHOLD)
        points = orb.detect(window, None)
        points, descriptor = orb.compute(window, [points[k] for k in _even(points, window.shape).tolist()])
        if not points:
            return FullSizeFeatures(centre_px, np.empty((0, 2)), np.empty((0, 32), np.uint8))
        px = np.array([point.pt for point in points]) + np.array([left, top])
        return FullSizeFeatures(centre_px, px, np.asarray(descriptor))

    def __len__(self) -> int:
        return len(self.px)

    def among(self, keep: BoolArray) -> FullSizeFeatures:
        """Some of them, (N,) bool."""
        return FullSizeFeatures(self.centre_px, self.px[keep], self.descriptor[keep])

    def locate(self, current: FullSizeFeatures) -> Homography | None:
        """own_H_cur of the frame with the `current` features; None where too few agree."""
        if min(len(self), len(current)) < _LEAST:
            return None
        own, other = _matched(self.descriptor, current.descriptor)
        return agreement.motion(current.px[other], self.px[own], _THRESHOLD_PX, _WINDOW_PX)


def _window(shape: tuple[int, ...], centre_px: FloatArray) -> tuple[int, int, int, int]:
    """Width, height, left and top of the window in an image of `shape`."""
    share = min(1.0, math.sqrt(_WINDOW_PX / (shape[0] * shape[1])))
    height, width = round(shape[0] * share), round(shape[1] * share)
    left, top = (int(np.clip(round(at - side / 2), 0, whole - side)) for at, side, whole
                 in zip(centre_px.tolist(), (width, height), (shape[1], shape[0]), strict=True))
    return width, height, left, top


def _even(points: Sequence[cv2.KeyPoint], shape: tuple[int, ...]) -> IdArray:
    """Which key points to keep: the strongest of each cell of a grid."""
    if len(points) <= _FEATURES:
        return np.arange(len(points))
    px, strength = np.array([point.pt for point in points]), np.array([point.response for point in points])
    column, row = (px * _CELLS / (shape[1], shape[0])).astype(int).T
    cell = row * _CELLS + column
    order = np.lexsort((-strength, cell))
    first = np.searchsorted(cell[order], cell[order])
    rank = np.arange(len(order)) - first
    return np.asarray(np.sort(order[np.argsort(rank, kind="stable")[:_FEATURES]]))


def _matched(own: Image, other: Image) -> tuple[IdArray, IdArray]:
    """Indices (n,) of mutual nearest neighbours that are clearly nearer than the second nearest."""
    distance, there = cv2.batchDistance(own, other, cv2.CV_32S, None, None, cv2.NORM_HAMMING, 2)
    clear = np.flatnonzero(distance[:, 0] < _RATIO * distance[:, 1])
    if not len(clear):
        return clear, clear
    _, back = cv2.batchDistance(other[there[clear, 0]], own, cv2.CV_32S, None, None, cv2.NORM_HAMMING, 1)
    mutual = clear[back[:, 0] == clear]
    return mutual, there[mutual, 0].astype(np.int64)
