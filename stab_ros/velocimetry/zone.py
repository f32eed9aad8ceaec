"""Where of the plane velocities are wanted: a region of the reference, looked up by place."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Homography
from stab_ros.velocimetry.plane_mask import PlaneMask
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

    @property
    def mask(self) -> PlaneMask | None:
        """The same on the plane; None: everywhere."""
        return None if self.allowed is None else PlaneMask(self.allowed, np.linalg.inv(self.plane_H_ref))

    def holds(self, vectors: Vectors) -> BoolArray:
        """(N,) bool: which vectors begin and end where velocities are wanted."""
        return self.holds_places(vectors.start_m) & self.holds_places(vectors.end_m)

    def holds_places(self, places_m: FloatArray) -> BoolArray:
        """(N,) bool: which places (N, 2) velocities are wanted of."""
        mask = self.mask
        return np.ones(len(places_m), bool) if mask is None else mask.holds(places_m)

    def outlines(self) -> list[FloatArray]:
        """Polygons (n, 2) on the plane around what is allowed, holes left out; none: everywhere."""
        if self.allowed is None:
            return []
        found, _ = cv2.findContours(self.allowed.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corners = [outline.reshape(-1, 2).astype(float) for outline in found]
        return [apply(self.plane_H_ref, outline) for outline in corners if len(outline) > 2]
