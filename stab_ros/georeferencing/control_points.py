"""Ground control points: the same points in the picture and in the map."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """N ground control points.

    Attributes:
        names: of each.
        image_px: (N, 2) float64, pixels of the image as taken.
        map_m: (N, 3) float64, east, north and up in the map.
        swapped_m: (N, 3) float64, as `map_m`, were the first two coordinates of the survey read the other way round;
            None: east and north are those.

    Raises:
        InputError: the shapes differ, a number is not finite, or two points have one name.
    """

    names: tuple[str, ...]
    image_px: FloatArray
    map_m: FloatArray
    swapped_m: FloatArray | None = None

    def __post_init__(self) -> None:
        n = len(self.names)
        if self.image_px.shape != (n, 2) or self.map_m.shape != (n, 3):
            raise InputError(f"{n} names of control points with {self.image_px.shape} pixels and {self.map_m.shape} "
                             "places, they must be of one number")
        if not (np.isfinite(self.image_px).all() and np.isfinite(self.map_m).all()):
            raise InputError("the coordinates of control points must be finite")
        twice = sorted(name for name, count in Counter(self.names).items() if count > 1)
        if twice:
            raise InputError(f"two control points are named {twice[0]!r}, names must differ")

    def __len__(self) -> int:
        return len(self.names)

    def where(self, chosen: BoolArray) -> ControlPoints:
        """The points for which `chosen`, (N,), is true."""
        names = tuple(name for name, yes in zip(self.names, chosen, strict=True) if yes)
        swapped_m = None if self.swapped_m is None else self.swapped_m[chosen]
        return ControlPoints(names, self.image_px[chosen], self.map_m[chosen], swapped_m)

    @property
    def swapped(self) -> ControlPoints:
        """The points, the first two coordinates of the survey read the other way round."""
        swapped_m = self.map_m[:, [1, 0, 2]] if self.swapped_m is None else self.swapped_m
        return ControlPoints(self.names, self.image_px, swapped_m)
