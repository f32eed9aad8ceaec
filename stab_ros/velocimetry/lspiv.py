"""LSPIV: velocities of water by cross-correlation of windows on the water plane, for surfaces without single features.

Fujita, Muste and Kruger (1998); ensemble correlation for rivers by Strelnikova et al. (2020). All pictures of an
interval are mapped to one grid of the plane, lens included. Their correlations are averaged over the pairs of the
interval before the peak is sought, first over a wide area, then in pictures drawn along what was found, with growing
time between the pictures of a pair: an error of a hundredth of a pixel matters less the farther the texture went, as
long as it is still the same. Of each window that time counts by which its variance is the smallest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.metrics.window_spectra import gaussian_peak
from stab_ros.velocimetry.correlation_ensemble import Ensemble, prepared
from stab_ros.velocimetry.correlation_scatter import moderated, scatter_px2, sharpness_px2, variance_factor
from stab_ros.velocimetry.intervals import IntervalFrames, IntervalMethod
from stab_ros.velocimetry.lspiv_field import filled, widened, window_mean
from stab_ros.velocimetry.lspiv_first import FirstSearch, Shifts, WindowGrid
from stab_ros.velocimetry.lspiv_plane import Plane, PlanePictures, in_polygons
from stab_ros.velocimetry.lspiv_settings import BLOCKS, LspivConfig
from stab_ros.velocimetry.lspiv_standing import Without, goes, may_stand, over_bed, relative_bias
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.shared_errors import ErrorModel, Measured
from stab_ros.velocimetry.sought import doubts_of_windows
from stab_ros.velocimetry.speeds import no_vectors
from stab_ros.velocimetry.vectors import Unit, Vectors
from stab_ros.velocimetry.vectors_join import joined

_MOST_FRAMES = 128  # of an interval that are kept; of more, every second is let go
_FEW_PAIRS = 8  # to search, and to decide how far apart pictures are compared
_SCATTER_DOF = 2.0 * (BLOCKS**2 - 1) / 2  # of a window's covariance; neighbouring blocks share texture
_LONGER = 4  # times the time between the pictures of a pair, from pass to pass
_REACH = 0.75  # half sides of what must be seen about a window, in sides: windows move by a quarter either way
_PEAK_SIGMA_PX = 0.0006  # what the fit of a peak is off by, alike in windows side by side
_LARGEST_SIGMA = 0.25  # of the speed of water that is seen beside what stands still
_LARGEST_STEP_PX = 0.5  # of the last pass: a larger one has found another peak


class Lspiv(IntervalMethod["_Pictures"]):
    """Measures the velocities of a grid of windows, anew for each interval; a `Method`."""

    def __init__(self, config: LspivConfig, unit: Unit = "m", water: Sequence[FloatArray] = ()) -> None:
        """Starts without frames.

        Args:
            config: how to measure.
            unit: of the plane.
            water: polygons (n, 2) on the plane, in which the middles of the windows lie; none: everywhere.
        """
        super().__init__(config.interval_s)
        self._config, self._unit, self._water = config, unit, tuple(water)
        self._next_id = 0

    def begun(self, frame: PlacedFrame) -> _Pictures:
        """See `IntervalMethod`.

        Raises:
            InputError: the frame shows nothing of the plane.
        """
        return _Pictures(self._windows(frame))

    def again(self, interval: _Pictures) -> _Pictures:
        """See `IntervalMethod`."""
        return _Pictures(interval.windows)

    def measured(self, interval: _Pictures) -> Vectors | None:
        """See `IntervalMethod`."""
        if len(interval.pictures) < 3:
            return None
        first_id, self._next_id = self._next_id, self._next_id + len(interval.windows.centres_px)
        vectors = interval.measured(self._config, self._unit, first_id)
        self.doubts = interval.doubts
        return vectors

    def _windows(self, frame: PlacedFrame) -> _Windows:
        reach_px = _REACH * self._config.window_px + self._config.window_px / 2
        plane = Plane.seen_by(frame, self._unit, self._config.resolution_m, self._water, reach_px)
        return _Windows(self._config, plane, self._water)


class _Windows:
    """The grid and its windows, which stay where they are for an epoch; they lie in rows and columns."""

    def __init__(self, config: LspivConfig, plane: Plane, water: Sequence[FloatArray]) -> None:
        side, self.step_px = config.window_px, config.window_px // config.windows_per_side
        self.plane, self.side_px, self.first_px = plane, side, (side - 1) / 2
        columns, rows = ((n - side) // self.step_px + 1 for n in plane.grid.size)
        if min(columns, rows) < 1:
            raise InputError(f"window_px: no window of {side} px fits into the grid of {plane.grid.size[0]}x"
                             f"{plane.grid.size[1]} px, make it smaller or resolution_m finer")
        self.shape = rows, columns
        x, y = (self.first_px + self.step_px * np.arange(n) for n in (columns, rows))
        self.centres_px = np.stack([axis.ravel() for axis in np.meshgrid(x, y)], axis=1)
        self.on_water = in_polygons(plane.to_plane(self.centres_px), water)
        self.pictures = PlanePictures(plane, config.interpolation)
        width, height = plane.grid.size
        self.errors = ErrorModel(plane.to_plane(np.array([[0.0, 0], [width, height]])))

    def blocks(self, wanted: BoolArray) -> BoolArray:
        """(r, c): which blocks the wanted windows, (N,), consist of."""
        every, (rows, columns) = self.step_px * BLOCKS // self.side_px, self.shape
        width, height = self.plane.grid.size
        blocks = np.zeros((height * BLOCKS // self.side_px, width * BLOCKS // self.side_px), bool)
        for dy, dx in np.ndindex(BLOCKS, BLOCKS):
            each = blocks[dy::every, dx::every][:rows, :columns]
            each |= wanted.reshape(self.shape)
        return blocks

    def parts(self, blocks: FloatArray) -> FloatArray:
        """(N, BLOCKS^2, n): what lies in each window, of all blocks (r, c, n)."""
        every = self.step_px * BLOCKS // self.side_px
        views = sliding_window_view(blocks, (BLOCKS, BLOCKS), axis=(0, 1))[::every, ::every]
        views = views[: self.shape[0], : self.shape[1]]
        return np.moveaxis(views, 2, -1).reshape(-1, BLOCKS**2, blocks.shape[2])


class _Pictures(IntervalFrames):
    """The pictures of an interval, and the velocities measured in them.

    doubts: what of them is doubtful, once they are measured; by kind.
    """

    def __init__(self, windows: _Windows) -> None:
        super().__init__(_MOST_FRAMES)
        self.windows = windows
        self.pictures: list[IdArray] = []
        self.seen: list[BoolArray] = []
        self.doubts: Mapping[str, str] = {}

    def keep(self, frame: PlacedFrame) -> None:
        windows = self.windows
        self.pictures.append(prepared(windows.pictures.make(frame), windows.side_px))
        self.seen.append(windows.pictures.shows(frame, windows.centres_px, _REACH * windows.side_px))
        self.errors.append(windows.errors.of(frame))

    def lists(self) -> tuple[list[Any], ...]:
        return self.pictures, self.seen

    def measured(self, config: LspivConfig, unit: Unit, first_id: int) -> Vectors:
        """The vectors of all windows that are seen in each frame and have a clear peak."""
        found = self._found(config, unit)
        parts = [self._as_vectors(config, unit, part, first_id) for part in found if len(part.at)]
        return joined(parts) if parts else no_vectors(unit, self.errors[0].columns)

    def _found(self, config: LspivConfig, unit: Unit) -> list[_Found]:
        """In the pictures as they are; over a bed, without what stands still in them; none where neither is sure."""
        usable = np.logical_and.reduce([*self.seen, self.windows.on_water])
        may = usable & may_stand(self.pictures, self.windows.centres_px, self.windows.side_px)
        moving = self._search(config, Without(self.pictures), usable).run() if may.any() else []
        moving = [one.only(one.is_sure()) for one in moving]
        way_px = self._way_px(moving)
        sure = may & goes(way_px)
        search = self._search(config, self.pictures, usable & ~sure)
        plain = search.run()
        plain_way_px = self._way_px(plain)
        bed = sure | over_bed(way_px, plain_way_px)
        told = ~bed & ~(may & goes(plain_way_px))  # what goes so far has nothing in common with what was there
        found = [*(one.only(told[one.at]) for one in plain), *(self._over_bed(one.only(bed[one.at])) for one in moving)]
        way_px = self._way_px(found)
        sure_px = self._way_px([one.only(one.is_sure()) for one in found])
        ground = search.grid.ground(np.where(np.isfinite(way_px), np.nan_to_num(sure_px), np.nan), search.first)
        px_m_s = self.windows.plane.grid.resolution_m / search.first_s
        limit_m_s = config.max_speed_m_s or search.first.reach_px * px_m_s
        self.doubts = doubts_of_windows(search.first, np.isfinite(way_px), ground, px_m_s, limit_m_s, unit)
        return [one.only(~ground[one.at]) for one in found]

    def _search(self, config: LspivConfig, pictures: Sequence[IdArray], usable: BoolArray) -> _Search:
        windows, seen = self.windows, np.logical_and.reduce(self.seen)
        grid = WindowGrid(windows.centres_px, windows.shape, windows.step_px, windows.side_px, seen)
        return _Search(config, pictures, np.array(self.stamps_ns), windows, grid, usable)

    def _way_px(self, found: Sequence[_Found]) -> FloatArray:
        """(N,) in the interval, of all windows; NaN: not found."""
        way_px = np.full(len(self.windows.centres_px), np.nan)
        for one in found:
            way_px[one.at] = np.hypot(*one.velocity_px_s.T) * (self.stamps_ns[-1] - self.stamps_ns[0]) * 1e-9
        return way_px

    def _over_bed(self, found: _Found) -> _Found:
        """With the error by what the mean takes of the water."""
        bias = relative_bias(self._way_px([found])[found.at])
        return found.widened(1.0, (bias * np.hypot(*found.velocity_px_s.T)) ** 2)

    def _as_vectors(self, config: LspivConfig, unit: Unit, found: _Found, first_id: int) -> Vectors:
        plane = self.windows.plane
        velocity, middle = plane.velocity(found.velocity_px_s), plane.to_plane(self.windows.centres_px[found.at])
        turn = plane.plane_H_grid[:2, :2]
        half = velocity * found.dt_s.mean() / 2
        measured = Measured(found.pairs, np.full(len(found.pairs), 1 / len(found.pairs)), found.dt_s,
                            middle - half, middle + half)
        shared = self.windows.errors.columns(self.errors, measured, velocity, config.clock_sigma, config.stamp_sigma_s)
        way = velocity * (self.stamps_ns[-1] - self.stamps_ns[0]) * 1e-9 / 2
        count = len(velocity)
        starts_ns, ends_ns = (np.full(count, stamp_ns) for stamp_ns in (self.stamps_ns[0], self.stamps_ns[-1]))
        return Vectors(middle - way, middle + way, starts_ns, ends_ns,
                       turn @ found.covariance_px2_s2 @ turn.T, shared, first_id + found.at, unit)


@dataclass(frozen=True, eq=False)
class _Found:
    """velocity_px_s (N, 2) of windows at (N,), its covariance (N, 2, 2), by pairs (P, 2) that are dt_s (P,) apart."""

    at: IdArray
    velocity_px_s: FloatArray
    covariance_px2_s2: FloatArray
    pairs: IdArray
    dt_s: FloatArray

    def only(self, these: BoolArray) -> _Found:
        """Those of the windows, (N,)."""
        return replace(self, at=self.at[these], velocity_px_s=self.velocity_px_s[these],
                       covariance_px2_s2=self.covariance_px2_s2[these])

    def is_sure(self) -> BoolArray:
        """(N,): which velocities are not as uncertain as they are large."""
        variance = np.trace(self.covariance_px2_s2, axis1=1, axis2=2)
        return np.asarray(variance < (_LARGEST_SIGMA * np.hypot(*self.velocity_px_s.T)) ** 2)

    def widened(self, factor: float, variance_px2_s2: FloatArray) -> _Found:
        """With covariances that are multiplied, and added to: variance_px2_s2 (N,)."""
        covariance = factor * self.covariance_px2_s2 + variance_px2_s2[:, None, None] * np.eye(2)
        return replace(self, covariance_px2_s2=covariance)


@dataclass(frozen=True, eq=False)
class _Level:
    """velocity_px_s (N, 2) and variance_px2_s2 (N,), inf: unknown, by few pairs that are `gap` frames apart."""

    gap: int
    velocity_px_s: FloatArray
    variance_px2_s2: FloatArray


class _Search:
    """From a wide search to the last pass.

    first: shifts by the wide search, between pictures that are first_s apart. grid: of the windows.
    """

    def __init__(self, config: LspivConfig, pictures: Sequence[IdArray], stamps_ns: IdArray, windows: _Windows,
                 grid: WindowGrid, usable: BoolArray) -> None:
        self._config, self._pictures, self._windows, self._usable = config, pictures, windows, usable
        self.grid = grid
        self._time_s = (stamps_ns - stamps_ns[0]) * 1e-9
        self._frame_s = float(np.median(np.diff(self._time_s)))
        self._ensemble = Ensemble(pictures, windows.side_px // BLOCKS)
        self._first_gap, reach_px = self._gap_and_reach_px()
        pairs = self._pairs(self._first_gap, _FEW_PAIRS)
        self.first = self._first(FirstSearch(pictures, pairs, grid, config.min_peak_ratio), reach_px)
        self.first_s = float(self._dt_s(pairs).mean())

    def run(self) -> list[_Found]:
        """Each window by all pairs, as far apart as a few of them measure it best."""
        levels = self._levels()
        variance = np.array([level.variance_px2_s2 for level in levels]).reshape(len(levels), len(self._usable))
        known = np.isfinite(variance).any(axis=0)
        at = [known & (variance.argmin(axis=0) == k) if known.any() else known for k in range(len(levels))]
        return self._scaled([self._measured(level, here) for level, here in zip(levels, at, strict=True)
                             if here.any()])

    def _scaled(self, found: Sequence[_Found]) -> list[_Found]:
        """With variances as large as the differences of windows side by side, of the same level as far as they tell.

        And with the error of the fit of the peak, which these differences do not show.
        """
        usual = self._variance_factor(found, 1.0)
        return [one.widened(self._variance_factor([one], usual),
                            np.full(len(one.at), (_PEAK_SIGMA_PX / one.dt_s.mean()) ** 2)) for one in found]

    def _levels(self) -> list[_Level]:
        velocity, clear, gap = self.first.shift_px / self.first_s, self.first.clear, self._first_gap
        levels: list[_Level] = []
        while clear.any():
            levels.append(self._level(velocity, clear, gap))
            velocity = levels[-1].velocity_px_s
            if gap == self._longest_gap:
                break
            gap = min(_LONGER * gap, self._longest_gap)
            clear = clear & (np.hypot(*velocity.T) * gap * self._frame_s <= self._windows.side_px / 2)
        return levels

    def _first(self, search: FirstSearch, reach_px: int) -> Shifts:
        """By a wide search; beyond a given range it is only asked whether lost windows go there from frame to frame."""
        if not reach_px:
            return search.widening(self._usable)
        found = search.within(self._usable, reach_px)
        each = FirstSearch(self._pictures, self._pairs(1, _FEW_PAIRS), self.grid, self._config.min_peak_ratio)
        beyond_px = reach_px / self._first_gap
        return replace(found, outrun=each.goes(found.lost, beyond_px, max(self._windows.side_px, int(2 * beyond_px))))

    def _gap_and_reach_px(self) -> tuple[int, int]:
        """Frames between the pictures of the wide search, and how far it reaches; 0: as far as it needs to."""
        if not self._config.max_speed_m_s:
            return 1, 0
        frame_px = self._config.max_speed_m_s / self._windows.plane.grid.resolution_m * self._frame_s
        gap = min(max(int(self._windows.side_px // 4 / frame_px), 1), self._longest_gap)
        return gap, int(np.ceil(gap * frame_px)) + 1

    def _level(self, velocity: FloatArray, clear: BoolArray, gap: int) -> _Level:
        """Velocities of clear windows improved by pairs that are `gap` frames apart, where there is a peak."""
        pairs = self._pairs(gap, _FEW_PAIRS)
        expected, parts = self._correlated(velocity, clear, clear, pairs)
        near, mean_s = parts.sum(axis=1), self._dt_s(pairs).mean()
        step = gaussian_peak(near)
        improved, variance = velocity.copy(), np.full(len(velocity), np.inf)
        improved[clear] = expected + np.nan_to_num(step) / mean_s
        good = np.isfinite(step).all(axis=1) & (near[:, 1, 1] >= self._config.min_correlation)
        covariance = moderated(scatter_px2(parts[good]), sharpness_px2(near[good]), _SCATTER_DOF)
        variance[np.flatnonzero(clear)[good]] = np.trace(covariance, axis1=1, axis2=2) / mean_s**2
        return _Level(gap, improved, variance)

    def _measured(self, level: _Level, at: BoolArray) -> _Found:
        pairs = self._pairs(level.gap, self._config.pairs)
        clear = np.isfinite(level.variance_px2_s2)
        expected, parts = self._correlated(level.velocity_px_s, clear, at, pairs)
        near = parts.sum(axis=1)
        step = gaussian_peak(near)
        good = (near[:, 1, 1] >= self._config.min_correlation) & (
            np.abs(step).max(axis=1, initial=0) <= _LARGEST_STEP_PX)  # NaN compares false
        dt_s = self._dt_s(pairs)
        mean_s = dt_s.mean()
        measured = (expected + step / mean_s)[good]
        covariance = moderated(scatter_px2(parts[good]), sharpness_px2(near[good]), _SCATTER_DOF) / mean_s**2
        return _Found(np.flatnonzero(at)[good], measured, covariance, pairs, dt_s)

    def _variance_factor(self, found: Sequence[_Found], usual: float) -> float:
        shape = (len(self._usable), 2)
        values, variance = np.full(shape, np.nan), np.ones(shape)
        for one in found:
            values[one.at], variance[one.at] = one.velocity_px_s, np.diagonal(one.covariance_px2_s2, axis1=1, axis2=2)
        grid = (*self._windows.shape, 2)
        return variance_factor(values.reshape(grid), variance.reshape(grid), self._config.windows_per_side, usual)

    def _correlated(self, velocity: FloatArray, clear: BoolArray, at: BoolArray, pairs: IdArray
                    ) -> tuple[FloatArray, FloatArray]:
        """Of the n windows `at`: velocities (n, 2) that they are drawn along, and correlations (n, BLOCKS^2, 3, 3).

        clear: (N,), where `velocity` is known. A window's parts add up to its correlation, 1 where pictures are alike.
        """
        windows = self._windows
        field = widened(filled(velocity.reshape(*windows.shape, 2), clear.reshape(windows.shape)))
        first_px, wanted = windows.first_px - windows.step_px, windows.blocks(at)
        total = sum(self._ensemble.blocks((a, b), dt_s * field, first_px, windows.step_px, wanted)
                    for (a, b), dt_s in zip(pairs.tolist(), self._dt_s(pairs).tolist(), strict=True))
        expected = window_mean(field, self._config.windows_per_side).reshape(-1, 2)
        sums = windows.parts(np.asarray(total))[at]
        power = np.maximum(sums[:, :, 9].sum(axis=1), 1e-9)
        return expected[at], (sums[:, :, :9] / power[:, None, None]).reshape(-1, BLOCKS**2, 3, 3)

    @property
    def _longest_gap(self) -> int:
        longest_s = self._config.gap_s or float(self._time_s[-1]) / 4
        return max(min(round(longest_s / self._frame_s), len(self._pictures) - 1), 1)

    def _pairs(self, gap: int, count: int) -> IdArray:
        """(P, 2): up to `count` pairs of pictures that are `gap` frames apart, even over the interval."""
        starts = np.unique(np.round(np.linspace(0, len(self._pictures) - 1 - gap, count)).astype(np.int64))
        return np.stack([starts, starts + gap], axis=1)

    def _dt_s(self, pairs: IdArray) -> FloatArray:
        return np.asarray(self._time_s[pairs[:, 1]] - self._time_s[pairs[:, 0]])
