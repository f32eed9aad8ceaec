"""Where of the plane velocities are wanted: a region of the reference, looked up by place."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import BoolArray, FloatArray, Homography
from stab_ros.velocimetry.vectors import Vectors


@dataclass(frozen=True, eq=False)
class Zone:
    """A region of one reference.

    Attributes:
        plane_H_ref: (3, 3), from its pixels to the plane.
        allowed: (h, w) bool, where velocities are wanted; None: everywhere.
    """

    plane_H_ref: Homography
    allowed: BoolArray | None = None

    def holds(self, vectors: Vectors) -> BoolArray:
        """(N,) bool: which vectors begin and end where velocities are wanted."""
        if self.allowed is None:
            return np.ones(len(vectors), bool)
        return self._allows(self.allowed, vectors.start_m) & self._allows(self.allowed, vectors.end_m)

    def outlines(self) -> list[FloatArray]:
        """Polygons (n, 2) on the plane around what is allowed, holes left out; none: everywhere."""
        if self.allowed is None:
            return []
        found, _ = cv2.findContours(self.allowed.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corners = [outline.reshape(-1, 2).astype(float) for outline in found]
        return [apply(self.plane_H_ref, outline) for outline in corners if len(outline) > 2]

    def pixels(self, places: FloatArray) -> FloatArray:
        """Pixels (N, 2) of the reference of places (N, 2)."""
        return apply(np.linalg.inv(self.plane_H_ref), places)

    def _allows(self, allowed: BoolArray, places: FloatArray) -> BoolArray:
        pixels = self.pixels(places)
        shown = inside(pixels, allowed.shape[::-1])
        column, row = np.round(np.where(shown[:, None], pixels, 0)).astype(int).T
        return np.asarray(shown & allowed[row, column])
