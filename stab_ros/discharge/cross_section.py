"""A surveyed cross-section: places, chainage and bed elevation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray

_FEWEST = 3  # points that make a section
_LARGEST_M = 1e5  # beyond it, coordinates are no section of a river


@dataclass(frozen=True, eq=False)
class CrossSection:
    """N points across a river, along a straight line.

    Attributes:
        position_m: (N, 2), east and north in the map, as surveyed.
        chainage_m: (N,), along the line from its first point, increasing.
        bed_m: (N,), elevation of the bed in the heights of the water level.
        along: (2,), unit vector of the line in the map.
        offset_m: (N,), of the points from the line, m.
        fixed_m: (2,), the place from which places are measured: the origin of the map, or where the line starts.
        line_m: distance between the two places that tell the line; None: the points themselves tell it.

    Raises:
        InputError: fewer than three points, or values that are not finite.
    """

    position_m: FloatArray
    chainage_m: FloatArray
    bed_m: FloatArray
    along: FloatArray
    offset_m: FloatArray
    fixed_m: FloatArray
    line_m: float | None = None

    def __post_init__(self) -> None:
        n = len(self.chainage_m)
        arrays = self.position_m, self.bed_m, self.along, self.offset_m, self.fixed_m
        shapes = tuple(values.shape for values in arrays)
        if shapes != ((n, 2), (n,), (2,), (n,), (2,)):
            raise ValueError(f"{n} points with arrays of {shapes}")
        if n < _FEWEST:
            raise InputError(f"a section of {counted(n, 'point')}, it must have at least {_FEWEST}")
        if not all(np.isfinite(values).all() for values in (self.position_m, self.chainage_m, self.bed_m)):
            raise InputError("a section with places or heights that are not finite, all must be numbers")

    def __len__(self) -> int:
        return len(self.chainage_m)

    @property
    def normal(self) -> FloatArray:
        """(2,) unit vector across the line, to the right of `along`."""
        return np.array([self.along[1], -self.along[0]])

    def at(self, chainage_m: FloatArray) -> CrossSection:
        """The section at other places along it, its bed and places interpolated linearly. chainage_m: increasing."""
        columns = (*self.position_m.T, self.bed_m, self.offset_m)
        east, north, bed, offset = (np.interp(chainage_m, self.chainage_m, column) for column in columns)
        return replace(self, position_m=np.column_stack([east, north]), chainage_m=np.asarray(chainage_m, float),
                       bed_m=bed, offset_m=offset)

    def with_places_times(self, factor: float) -> CrossSection:
        """The section with its places, but not its heights, in another unit."""
        return replace(self, position_m=self.fixed_m + factor * (self.position_m - self.fixed_m),
                       chainage_m=factor * self.chainage_m, offset_m=factor * self.offset_m)


def referenced(position_m: FloatArray, bed_m: FloatArray) -> CrossSection:
    """The section of points surveyed in the map.

    The line is that of least squares; the chainage of a point is its place along it, so that points beside the line
    add no width. Points are put in the order of their chainage, from the end at which the survey began.

    Args:
        position_m: (N, 2), east and north.
        bed_m: (N,), bed elevation.

    Raises:
        InputError: fewer than three points, values that are not finite, or all in one place.
    """
    position_m, bed_m = np.asarray(position_m, float), np.asarray(bed_m, float)
    if len(position_m) < _FEWEST:
        raise InputError(f"a section of {counted(len(position_m), 'point')}, it must have at least {_FEWEST}")
    centre = position_m.mean(axis=0)
    _, _, directions = np.linalg.svd(np.nan_to_num(position_m - centre), full_matrices=False)
    along = directions[0] * (1.0 if directions[0] @ (position_m[-1] - position_m[0]) >= 0 else -1.0)
    places = (position_m - centre) @ along
    order = np.argsort(places, kind="stable")
    chainage = places[order] - places[order[0]]
    _check_length(chainage)
    offset = ((position_m - centre) @ np.array([along[1], -along[0]]))[order]
    return CrossSection(position_m[order], chainage, bed_m[order], along, offset, np.zeros(2))


def between(start_m: FloatArray, end_m: FloatArray, chainage_m: FloatArray, bed_m: FloatArray,
            start_chainage_m: float = 0.0) -> CrossSection:
    """The section of points at known distances along a line between two places.

    Args:
        start_m: (2,), where the line starts: east and north.
        end_m: (2,), where it ends, or any place in it: its direction counts.
        chainage_m: (N,), distance of each point.
        bed_m: (N,), bed elevation.
        start_chainage_m: the chainage at `start_m`.

    Raises:
        InputError: both ends in one place, fewer than three points, or values that are not finite.
    """
    start_m, end_m = np.asarray(start_m, float), np.asarray(end_m, float)
    length_m = float(np.linalg.norm(end_m - start_m))
    if not 0 < length_m < _LARGEST_M:
        raise InputError(f"start and end of the section are {length_m:g} m apart, they must be two places in the map")
    along = (end_m - start_m) / length_m
    order = np.argsort(chainage_m, kind="stable")
    distance = np.asarray(chainage_m, float)[order]
    _check_length(distance)
    position = start_m + (distance - start_chainage_m)[:, None] * along
    return CrossSection(position, distance, np.asarray(bed_m, float)[order], along, np.zeros(len(distance)),
                        start_m, length_m)


def _check_length(chainage_m: FloatArray) -> None:
    if not np.isfinite(chainage_m).all():
        raise InputError("a section with places that are not finite, all must be numbers")
    length_m = float(chainage_m[-1] - chainage_m[0]) if len(chainage_m) else 0.0
    if not 0 < length_m < _LARGEST_M:
        raise InputError(f"a section of {length_m:g} m, it must reach across a river, with places in metres")
