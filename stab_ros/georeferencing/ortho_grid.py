"""The grid of an orthophoto: north up, square pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray, Homography

MOST_PIXELS = 180_000_000  # of an orthophoto; the third paper scales larger ones down (section 2.2.3)


@dataclass(frozen=True)
class OrthoGrid:
    """Places of the pixels of an orthophoto in the map.

    Attributes:
        west_m: east coordinate of the left border of the image (of its pixels' border, not their centre).
        north_m: north coordinate of the upper border.
        resolution_m: side of a pixel.
        columns: width, px.
        rows: height, px.

    Raises:
        InputError: not finite, no pixel, or more than `MOST_PIXELS`.
    """

    west_m: float
    north_m: float
    resolution_m: float
    columns: int
    rows: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.west_m) and math.isfinite(self.north_m) and 0 < self.resolution_m < math.inf):
            raise InputError("the corner and the resolution of an orthophoto must be finite, and the latter positive")
        if self.columns < 1 or self.rows < 1 or self.columns * self.rows > MOST_PIXELS:
            raise InputError(f"an orthophoto of {self.columns}x{self.rows} pixels, it must have 1 to {MOST_PIXELS}")

    @staticmethod
    def covering(outline_m: FloatArray, resolution_m: float) -> OrthoGrid:
        """The grid that covers an outline, its corner a whole number of pixels from the origin of the map.

        The resolution is doubled until the grid has no more than `MOST_PIXELS` (Perks 2020, section 2.2.3).

        Args:
            outline_m: (n, 2), east and north.
            resolution_m: side of a pixel.
        """
        (west, south), (east, north) = outline_m.min(axis=0), outline_m.max(axis=0)
        while True:
            left, top = math.floor(west / resolution_m), math.ceil(north / resolution_m)
            columns, rows = math.ceil(east / resolution_m) - left, top - math.floor(south / resolution_m)
            if columns * rows <= MOST_PIXELS:
                return OrthoGrid(left * resolution_m, top * resolution_m, resolution_m, max(columns, 1), max(rows, 1))
            resolution_m *= 2

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.columns, self.rows

    @property
    def map_H_ortho(self) -> Homography:
        """Homography (3, 3) from pixel centres of the orthophoto to east and north, m."""
        r = self.resolution_m
        return np.array([[r, 0, self.west_m + r / 2], [0, -r, self.north_m - r / 2], [0, 0, 1]])

    @property
    def ortho_H_map(self) -> Homography:
        """Homography (3, 3) from east and north, m, to pixel centres of the orthophoto."""
        r = self.resolution_m
        return np.array([[1 / r, 0, -self.west_m / r - 0.5], [0, -1 / r, self.north_m / r - 0.5], [0, 0, 1]])
