"""Velocities as arrows on the picture in which they were measured."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Image
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import pixels_of
from stab_ros.velocimetry.speeds import speed_m_s
from stab_ros.velocimetry.vectors import Vectors

_FRACTION_BITS = 4  # of coordinates, as OpenCV takes them
_FAR_PX = 30_000.0  # beyond, OpenCV's coordinates overflow


def speed_colours(speed: FloatArray, fastest: float) -> FloatArray:
    """Red, green and blue (N, 3), 0 to 1, from blue (0) to red (`fastest` and above)."""
    levels = np.clip(255 * speed / (fastest or 1.0), 0, 255).astype(np.uint8)
    if not len(levels):
        return np.zeros((0, 3))
    return np.asarray(cv2.applyColorMap(levels[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1] / 255.0)


def arrow_picture(placed: PlacedFrame, vectors: Vectors) -> Image:
    """The picture of the last frame of an interval, (h, w, 3) bgr8, with an arrow along each vector."""
    image = cv2.cvtColor(placed.gray, cv2.COLOR_GRAY2BGR)
    speed = speed_m_s(vectors)
    colours = 255 * speed_colours(speed, float(np.percentile(speed, 99)) if len(speed) else 1.0)[:, ::-1]
    starts, ends = pixels_of(placed, vectors.start_m), pixels_of(placed, vectors.end_m)
    farthest = np.abs(np.concatenate([starts, ends], axis=1)).max(axis=1, initial=0)  # NaN: not shown
    seen: BoolArray = np.asarray(farthest < _FAR_PX)
    for start, end, colour in zip(starts[seen], ends[seen], colours[seen].tolist(), strict=True):
        (x0, y0), (x1, y1) = (np.round(point * 2**_FRACTION_BITS).astype(int).tolist() for point in (start, end))
        cv2.arrowedLine(image, (x0, y0), (x1, y1), colour, 1, cv2.LINE_AA, _FRACTION_BITS, 0.3)
    return np.asarray(image)
