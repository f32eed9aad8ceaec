"""A part of the water plane: a mask in any pixels that have a known place on the plane, or polygons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.region import check_polygon
from stab_ros.core.types import BoolArray, FloatArray, Homography

_MASK_PX = 2048  # longer side of the mask of polygons


@dataclass(frozen=True, eq=False)
class PlaneMask:
    """Which places on the plane belong to a region.

    Attributes:
        mask: (h, w) bool.
        mask_H_plane: (3, 3), from places to pixels of the mask; what lies outside it does not belong.
    """

    mask: BoolArray
    mask_H_plane: Homography

    @staticmethod
    def of_polygons(polygons_m: Sequence[FloatArray], name: str = "roi") -> PlaneMask:
        """The inside of polygons, each (n, 2), on the plane, true within half a thousandth of their extent.

        Raises:
            InputError: no polygon, or one without area.
        """
        for polygon in polygons_m:
            check_polygon(name, polygon)
        corners = np.concatenate(list(polygons_m))
        low, extent = corners.min(axis=0), float(np.ptp(corners, axis=0).max())
        scale = (_MASK_PX - 1) / extent
        mask_H_plane = np.array([[scale, 0, -scale * low[0]], [0, scale, -scale * low[1]], [0, 0, 1]])
        canvas = np.zeros((_MASK_PX, _MASK_PX), np.uint8)
        for polygon in polygons_m:
            cv2.fillPoly(canvas, [np.round(apply(mask_H_plane, polygon)).astype(np.int32)], 1)
        return PlaneMask(canvas.astype(bool), mask_H_plane)

    def inverted(self) -> PlaneMask:
        """What the mask shows and does not hold: the water of a map of the static ground."""
        return PlaneMask(~self.mask, self.mask_H_plane)

    def holds(self, places_m: FloatArray) -> BoolArray:
        """(N,) bool: which places (N, 2) belong to it."""
        at = apply(self.mask_H_plane, places_m)
        at = np.where(np.isfinite(at), np.round(at), -1).astype(np.int64)
        inside = np.asarray(((at >= 0) & (at < self.mask.shape[::-1])).all(axis=1))
        at = np.where(inside[:, None], at, 0)
        return np.asarray(inside & self.mask[at[:, 1], at[:, 0]])
