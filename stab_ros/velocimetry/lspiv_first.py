"""Where windows go from picture to picture: the first, wide search of LSPIV, which goes on where windows are lost.

Without a given highest speed it begins with a quarter of a window and goes on to a half and a whole one, for windows
that have no clear peak, where a few of them find theirs so, and for those of a texture that repeats. The windows
beside them are sought anew, too: their peak may be one by chance, or of ground that they show with the water. Where
nearly all that moves is lost nevertheless, what stands still beside it is taken for ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.correlation_blocks import from_spline
from stab_ros.velocimetry.correlation_ensemble import searched
from stab_ros.velocimetry.repeating import periods_px

_LEAST_POWER = 0.5  # of a window with texture: a band-passed contrast of a grey level
_PROBED = 64  # windows that are sought over a wider range, before all are
_LEAST_FOUND = 0.25  # of those, else the wider range is left
_STANDING_PX = 0.5  # between two pictures
_NEARLY_ALL = 0.75  # share of lost windows among those that do not stand
_MANY = 0.25  # share of lost windows among all that have texture
_STANDING_WAY_PX = 3.0  # in an interval


@dataclass(frozen=True, eq=False)
class WindowGrid:
    """N = rows * columns windows on a grid: centres_px (N, 2), step_px and side_px; seen (N,), with a quarter about."""

    centres_px: FloatArray
    shape: tuple[int, int]
    step_px: int
    side_px: int
    seen: BoolArray

    def beside(self, these: BoolArray) -> BoolArray:
        """(N,): those that overlap or touch these, (N,)."""
        side = 2 * (self.side_px // self.step_px) + 1
        near = cv2.dilate(these.reshape(self.shape).astype(np.uint8), np.ones((side, side), np.uint8))
        return np.asarray(near.ravel() > 0)

    def ground(self, way_px: FloatArray, first: Shifts) -> BoolArray:
        """(N,): what stands beside lost windows, where nearly all that moves was lost and the water is too fast.

        It is where some windows have gone far; or where there are few but the lost ones, which says less.

        way_px: (N,) in an interval, 0: none for sure; NaN: unknown. first: where the windows go.
        """
        lost, stands = first.lost & np.isnan(way_px), way_px < _STANDING_WAY_PX  # NaN compares false
        count, known = np.count_nonzero(lost), np.count_nonzero(np.isfinite(way_px))
        moving = known - np.count_nonzero(stands)
        nearly_all = count and count >= max(_NEARLY_ALL * (count + moving), _MANY * (count + known))
        fast = first.outrun or count >= _NEARLY_ALL * (count + known)
        return stands & self.beside(lost) if nearly_all and fast else np.zeros(len(lost), bool)

    def stay_in_sight(self, shift_px: FloatArray) -> BoolArray:
        """(N,): which are seen half of their shift, (N, 2), back and forth."""
        length = np.hypot(*shift_px.T)[:, None]
        beyond = shift_px / 2 * np.maximum(1 - self.side_px / 2 / np.maximum(length, 1e-9), 0)
        return np.asarray(self._seen_at(self.centres_px - beyond) & self._seen_at(self.centres_px + beyond))

    def _seen_at(self, places_px: FloatArray) -> BoolArray:
        column, row = np.round((places_px - self.centres_px[0]) / self.step_px).astype(np.int64).T
        rows, columns = self.shape
        within = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.asarray(within & self.seen[np.where(within, row * columns + column, 0)])


@dataclass(frozen=True, eq=False)
class Shifts:
    """Where N windows go from one picture of a pair to the other.

    Attributes:
        shift_px: (N, 2).
        clear: (N,), where that is known.
        textured: (N,), windows that were sought and show something.
        period_px: (N,), of texture that repeats; inf: it does not, or it was not looked for.
        reach_px: farthest shift in x and y that was sought, at least by a few windows.
        outrun: whether some go farther than they were sought first.
    """

    shift_px: FloatArray
    clear: BoolArray
    textured: BoolArray
    period_px: FloatArray
    reach_px: int
    outrun: bool = False

    @property
    def lost(self) -> BoolArray:
        """(N,): what shows something, but no clear peak."""
        return self.textured & ~self.clear

    @property
    def standing(self) -> BoolArray:
        """(N,): what does not move from one picture of a pair to the other."""
        return np.asarray(self.clear & (np.hypot(*self.shift_px.T) < _STANDING_PX))

    def merged(self, other: Shifts, these: BoolArray) -> Shifts:
        """With what the other one, of a wider search, has for these windows, (N,); none that moves is lost by it."""
        taken = these & (other.clear | ~self.clear | self.standing)
        return replace(self, shift_px=np.where(taken[:, None], other.shift_px, self.shift_px),
                       clear=np.where(taken, other.clear, self.clear), reach_px=other.reach_px)

    def unambiguous(self, period_px: FloatArray) -> Shifts:
        """Without those of texture that repeats every period_px, (N,), where not all that looks alike was sought."""
        longest_px = np.abs(self.shift_px).max(axis=1) + period_px
        unlike = np.isinf(period_px) | (longest_px <= self.reach_px)
        return replace(self, clear=self.clear & unlike, period_px=period_px)


class FirstSearch:
    """Seeks windows over a wide range, by few pairs of pictures."""

    def __init__(self, pictures: Sequence[IdArray], pairs: IdArray, windows: WindowGrid, min_ratio: float) -> None:
        """Args: pictures (h, w) int16, of `prepared`; pairs (P, 2); min_ratio, of the highest peak to the second."""
        self._pictures, self._pairs, self._windows, self._min_ratio = pictures, pairs, windows, min_ratio

    def within(self, usable: BoolArray, reach_px: int) -> Shifts:
        """Shifts of the usable windows, (N,), in a range that is known to hold them."""
        found = self._sought(usable, reach_px)
        return replace(found, period_px=self._periods_px(found.lost))

    def widening(self, usable: BoolArray) -> Shifts:
        """Shifts of the usable windows, (N,), in as wide a range as they need, up to a window."""
        side = self._windows.side_px
        found = self._sought(usable, side // 4)
        period_px = self._periods_px(usable)
        repeats = found.textured & np.isfinite(period_px)
        for reach_px in (side // 2, side):
            lost = found.lost & ~repeats
            again = (repeats | lost) if self.goes(lost, 0, reach_px) else repeats
            again = again | (found.clear & self._windows.beside(again))  # by chance, or on the ground beside
            if again.any():
                found = found.merged(self._sought(again, reach_px), again)
        found = found.unambiguous(period_px)
        outrun = bool((np.abs(found.shift_px[found.clear]) > side // 4).any())
        return replace(found, reach_px=side if (found.lost | repeats).any() else found.reach_px, outrun=outrun)

    def goes(self, these: BoolArray, least_px: float, reach_px: int) -> bool:
        """Whether a few of these windows, (N,), find a clear peak within reach_px, at least_px or farther."""
        at = np.flatnonzero(these)
        probed = np.zeros(len(these), bool)
        probed[at[:: len(at) // _PROBED + 1]] = True
        if not len(at):
            return False
        found = self._sought(probed, reach_px)
        far = np.abs(found.shift_px).max(axis=1) >= least_px
        return bool((found.clear & far)[probed].mean() >= _LEAST_FOUND)

    def _sought(self, these: BoolArray, reach_px: int) -> Shifts:
        windows, at = self._windows, np.flatnonzero(these)
        shift, ratio = searched(self._pictures, self._pairs, windows.centres_px[at], windows.side_px, reach_px)
        shift_px, clear = np.zeros((len(these), 2)), np.zeros(len(these), bool)
        shift_px[at] = shift
        clear[at] = (ratio >= self._min_ratio) & (np.abs(shift).max(axis=1, initial=0) < reach_px)
        clear &= windows.stay_in_sight(shift_px)
        return Shifts(shift_px, clear, these & self._textured(), np.full(len(these), np.inf), reach_px)

    def _periods_px(self, these: BoolArray) -> FloatArray:
        period_px = np.full(len(these), np.inf)
        at = np.flatnonzero(these)
        first = self._pictures[int(self._pairs[0, 0])]
        period_px[at] = periods_px(first, self._windows.centres_px[at], self._windows.side_px)
        return period_px

    def _textured(self) -> BoolArray:
        windows, picture = self._windows, from_spline(self._pictures[int(self._pairs[0, 0])])
        side = windows.side_px
        x, y = np.round(windows.centres_px - (side - 1) / 2).astype(np.int64).T
        power = cv2.boxFilter(cv2.multiply(picture, picture), -1, (side, side), anchor=(0, 0))
        return np.asarray(power[y, x] > _LEAST_POWER)
