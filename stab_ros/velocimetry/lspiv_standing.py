"""A pattern that stands still in moving water, as a visible bed: where there is one, and pictures without it.

The mean over time of each place is the standing pattern, and what a moving one leaves on its way, which is the less the
farther it goes. Means of the first and of the last quarter of the interval have nothing in common but what stands, once
the water went a few sizes of its texture in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.correlation_blocks import from_spline

_LEAST_ALIKE = 0.25  # correlation of the two means
_LEAST_SHARE = 0.05  # of the power of the pictures; of less than that no peak is drawn aside
_LONG_WAY_PX = 10.0  # of water in the interval that leaves next to nothing in common to its quarters
_SHORT_WAY_PX, _SHORTEST_WAY_PX = 6.0, 3.0  # of water that is told from what stands by how much slower it is with it
_SLOWER, _MUCH_SLOWER, _FAR_SLOWER = 0.85, 0.65, 0.4  # times as fast, after a long, a short and the shortest way
_LOST_PX = 4.5  # way on which the mean takes all of a moving pattern: twice the band-pass's correlation length


def may_stand(pictures: Sequence[IdArray], centres_px: FloatArray, side_px: int) -> BoolArray:
    """(N,) bool: where the first and the last quarter of the interval have something in common.

    That is a standing pattern, or all the water is slow.

    Args:
        pictures: (h, w) int16, of `prepared`, in order of time.
        centres_px: (N, 2) of the windows.
        side_px: of the windows.
    """
    count = max(len(pictures) // 4, 1)
    first, last = (from_spline(_mean(part)) for part in (pictures[:count], pictures[-count:]))
    x, y = np.round(centres_px - (side_px - 1) / 2).astype(np.int64).T
    both, one, other = (cv2.boxFilter(a * b, -1, (side_px, side_px), anchor=(0, 0))[y, x]
                        for a, b in ((first, last), (first, first), (last, last)))
    return np.asarray((both > _LEAST_ALIKE * np.sqrt(one * other)) & (both > _LEAST_SHARE))


def over_bed(way_px: FloatArray, plain_way_px: FloatArray) -> BoolArray:
    """(N,) bool: where water is much slower in pictures as they are than without what stands still in them.

    The mean takes part of slow water with it, too, which makes it seem faster by a few tenths: without a bed the plain
    way is 0.62 or more of the other one, over one that is stronger than the water's pattern 0.2 or less.

    Args:
        way_px: (N,) in the interval, in pictures without their mean; NaN: unknown.
        plain_way_px: (N,) in the pictures as they are; NaN: unknown.
    """
    share = np.select([goes(way_px), way_px >= _SHORT_WAY_PX], [_SLOWER, _MUCH_SLOWER], _FAR_SLOWER)
    return np.asarray((way_px >= _SHORTEST_WAY_PX) & (plain_way_px < share * way_px))


def goes(way_px: FloatArray) -> BoolArray:
    """(N,) bool: whether water that goes so far in the interval, (N,), cannot be taken for what stands."""
    return np.asarray(way_px >= _LONG_WAY_PX)


def relative_bias(way_px: FloatArray) -> FloatArray:
    """(N,) of the velocity, by what the mean takes of water that goes so far in the interval, (N,).

    As of space-time images (`stiv_standing`) it falls with the third power of the way.
    """
    return np.asarray((_LOST_PX / np.maximum(way_px, _LOST_PX)) ** 3)


def _mean(pictures: Sequence[IdArray]) -> IdArray:
    """(h, w) int16, over time."""
    total = np.zeros(pictures[0].shape, np.int32)
    for picture in pictures:
        total += picture
    return np.asarray(np.round(total / len(pictures)), np.int16)


class Without(Sequence[IdArray]):
    """Pictures less what stands still in them; made when they are asked for, so that they take no memory."""

    def __init__(self, pictures: Sequence[IdArray]) -> None:
        """Args: pictures (h, w) int16, of `prepared`; what stands is their mean."""
        self._pictures, self._standing = pictures, _mean(pictures)

    def __len__(self) -> int:
        return len(self._pictures)

    @overload
    def __getitem__(self, index: int) -> IdArray: ...

    @overload
    def __getitem__(self, index: slice) -> list[IdArray]: ...

    def __getitem__(self, index: int | slice) -> IdArray | list[IdArray]:
        if isinstance(index, slice):
            return [picture - self._standing for picture in self._pictures[index]]
        return self._pictures[index] - self._standing
