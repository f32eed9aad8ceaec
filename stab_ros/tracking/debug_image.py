"""The debug image: the features that the last fit used, and those that it rejected."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.gray import grey_range, to_gray
from stab_ros.core.types import FloatArray, Frame, Image
from stab_ros.tracking.stabilizer import Stabilizer

_USED, _REJECTED = (0, 255, 0), (0, 0, 255)  # bgr
_SUBPIXEL_BITS = 4


def draw_debug(frame: Frame, stabilizer: Stabilizer) -> Image:
    """The frame just tracked, (h, w, 3) bgr8, its features circled: green used, red rejected (all, while lost)."""
    canvas = cv2.cvtColor(to_gray(frame, grey_range(frame)), cv2.COLOR_GRAY2BGR)
    if stabilizer.last_match is not None:
        pairs, fit = stabilizer.last_match
        used = np.zeros(len(pairs), bool) if fit is None else fit.inlier
        _circle(canvas, pairs.current_px[~used], _REJECTED)
        _circle(canvas, pairs.current_px[used], _USED)
    return np.asarray(canvas)


def _circle(canvas: Image, points: FloatArray, colour: tuple[int, int, int]) -> None:
    radius = max(2, canvas.shape[1] // 400) << _SUBPIXEL_BITS
    for x, y in np.round(points * 2**_SUBPIXEL_BITS).astype(int).tolist():
        cv2.circle(canvas, (x, y), radius, colour, 1, cv2.LINE_AA, _SUBPIXEL_BITS)
