"""Regions of the reference: polygons or masks of `roi` and `exclude`."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Region:
    """A part of the reference, given by polygons or by a mask.

    Attributes:
        name: stands in error messages, as `roi`.
        polygons: each (n, 2) float64, the corners x, y along the outline, in pixels of the reference.
        mask: (h, w) bool of the size of the reference; takes the place of polygons.

    Raises:
        InputError: a polygon has fewer than 3 corners, crosses itself, has no area or is not finite.
    """

    name: str
    polygons: tuple[FloatArray, ...] = ()
    mask: BoolArray | None = None

    def __post_init__(self) -> None:
        for polygon in self.polygons:
            check_polygon(self.name, polygon)

    def inside(self, size: tuple[int, int]) -> BoolArray:
        """Rasterizes the region.

        Args:
            size: width and height of the reference, px.

        Returns:
            (h, w) bool: which pixels lie inside.

        Raises:
            InputError: the mask has another size, or all polygons lie outside the reference.
        """
        if self.mask is not None:
            if self.mask.shape != (size[1], size[0]):
                raise InputError(f"{self.name}: the mask is {self.mask.shape[1]}x{self.mask.shape[0]}, "
                                 f"it must be {size[0]}x{size[1]} as the reference")
            return self.mask
        canvas = np.zeros((size[1], size[0]), np.uint8)
        for polygon in self.polygons:
            cv2.fillPoly(canvas, [np.round(polygon).astype(np.int32)], 1)
        if not canvas.any():
            raise InputError(f"{self.name}: it lies outside the reference of {size[0]}x{size[1]} px")
        return canvas.astype(bool)


@dataclass(frozen=True, eq=False)
class Area:
    """Where features may lie: inside `roi`, but not inside `exclude`.

    Attributes:
        roi: where static ground is; None: everywhere.
        exclude: what to leave out, such as the water; None: nothing.
    """

    roi: Region | None = None
    exclude: Region | None = None

    def allowed(self, size: tuple[int, int]) -> BoolArray:
        """Rasterizes the area.

        Args:
            size: width and height of the reference, px.

        Returns:
            (h, w) bool: which pixels may hold features.

        Raises:
            InputError: no pixel is left, or a region does not fit the reference.
        """
        allowed = np.ones((size[1], size[0]), bool) if self.roi is None else self.roi.inside(size).copy()
        if self.exclude is not None:
            allowed &= ~self.exclude.inside(size)
        if not allowed.any():
            raise InputError("roi and exclude leave no part of the reference, they must leave static ground")
        return allowed


def check_polygon(name: str, polygon: FloatArray) -> None:
    """Validates a polygon (N, 2), px.

    Raises:
        InputError: fewer than 3 points, coordinates that are not finite, zero area, or intersecting sides.
    """
    if polygon.ndim != 2 or polygon.shape[1:] != (2,) or len(polygon) < 3:
        raise InputError(f"{name}: a polygon needs at least 3 points [x, y]")
    if not np.isfinite(polygon).all() or np.abs(polygon).max() > 1e6:
        raise InputError(f"{name}: a polygon's coordinates must be finite numbers of pixels")
    if _self_intersects(polygon):
        raise InputError(f"{name}: the polygon crosses itself, list its corners in order along the outline")
    if _area_px2(polygon) == 0:
        raise InputError(f"{name}: the polygon has no area, its points must not lie on one line")


def _area_px2(polygon: FloatArray) -> float:
    """Area by the shoelace formula relative to the first point; parts of a self-intersecting polygon may cancel."""
    x, y = (polygon - polygon[0]).T
    return float(abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2)


def _self_intersects(polygon: FloatArray) -> bool:
    n = len(polygon)
    sides = [(polygon[i], polygon[(i + 1) % n]) for i in range(n)]
    return any(
        _segments_cross(*sides[i], *sides[j])
        for i in range(n)
        for j in range(i + 2, n)
        if (j + 1) % n != i  # neighbours share a corner
    )


def _segments_cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    return bool(_side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0)


def _side(a: FloatArray, b: FloatArray, p: FloatArray) -> float:
    return float(np.sign((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])))
