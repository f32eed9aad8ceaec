"""A line on the water plane, and how a frame shows it: one row of its space-time image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.velocimetry.lspiv_plane import camera_of
from stab_ros.velocimetry.placed_frame import PlacedFrame

_MOST_SAMPLES = 4096


@dataclass(frozen=True, eq=False)
class Line:
    """Samples along a line.

    Attributes:
        begin: (2,) on the plane.
        along: (2,) unit vector, in which velocities count positive.
        step: distance of the samples, units of the plane.
        count: number of samples.
        rows: number of parallel rows, a step apart, whose mean is taken.
    """

    begin: FloatArray
    along: FloatArray
    step: float
    count: int
    rows: int

    @staticmethod
    def between(ends: FloatArray, step: float, rows: int) -> Line:
        """The line between two points (2, 2).

        Raises:
            InputError: the points are not finite or not apart, or the line has too many samples.
        """
        length = float(np.linalg.norm(ends[1] - ends[0])) if np.shape(ends) == (2, 2) else np.nan
        if not (np.isfinite(ends).all() and step < length < _MOST_SAMPLES * step):
            raise InputError(f"a line from {ends[0]} to {ends[-1]} in steps of {step:g}, it must have two points that "
                             f"are 2 to {_MOST_SAMPLES} steps apart")
        return Line(ends[0], (ends[1] - ends[0]) / length, step, int(length / step) + 1, rows)

    @property
    def across(self) -> FloatArray:
        """(2,) unit vector, a quarter turn from `along`."""
        return np.array([-self.along[1], self.along[0]])

    def place(self, at: float) -> FloatArray:
        """(2,) on the plane, `at` samples from the begin."""
        return np.asarray(self.begin + at * self.step * self.along)

    def seen_by(self, frame: PlacedFrame) -> tuple[FloatArray, BoolArray]:
        """The samples (count,) in grey levels, and which of them the frame shows (count,)."""
        pixels = self._pixels(frame)
        size = frame.gray.shape[1], frame.gray.shape[0]
        shown = inside(pixels - 1, (size[0] - 2, size[1] - 2)).reshape(self.rows, self.count)  # NaN compares false
        x, y = np.nan_to_num(pixels, nan=-1e6).astype(np.float32).T.reshape(2, self.rows, self.count)
        values = cv2.remap(frame.gray.astype(np.float32), x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(values, np.float64).mean(axis=0), np.asarray(shown.all(axis=0))

    def _pixels(self, frame: PlacedFrame) -> FloatArray:
        """Pixels (rows * count, 2) of the frame as taken."""
        aside = (np.arange(self.rows) - (self.rows - 1) / 2)[:, None, None] * self.across
        places = self.begin + self.step * (aside + np.arange(self.count)[:, None] * self.along)
        pixels = apply(np.linalg.inv(frame.plane_H_image), places.reshape(-1, 2))
        pixels[pixels @ frame.plane_H_image[2, :2] + frame.plane_H_image[2, 2] <= 0] = np.nan
        camera = camera_of(frame)
        return camera.pixels((pixels - camera.K[:2, 2]) @ np.linalg.inv(camera.K[:2, :2]).T)


def longest_run(shown: BoolArray) -> slice:
    """The longest part of (n,) that is True without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], shown, [False]])))
    begins, ends = edges[::2], edges[1::2]
    if not len(begins):
        return slice(0, 0)
    k = int(np.argmax(ends - begins))
    return slice(int(begins[k]), int(ends[k]))
