"""Rows that swing during the start-up: found in the trajectories before planes are, and taken out of them.

Each feature may move steadily (water) or rest (ground). What the features of a row share beyond that, in one frame
and not in the next, is the rolling shutter. What they share in all frames after the reference, from the first on, is
that of the reference itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.estimation.rows import independent_share
from stab_ros.tracking.feature_tracks import Trajectories
from stab_ros.tracking.rolling_shutter import INDEPENDENT

_BANDS = 32
_STRIPS = 8
_LEAST_FRAMES, _SEEN = 8, 0.75
_LEAST_IN_BAND, _LEAST_CELLS = 3, 0.3  # of the bands of all frames
_STEADY_PX = 2.5  # RMS about a steady motion: the rest is foam and leaves
_SWING_PX = 0.06  # RMS of what both halves of the strips show alike


def without_rows(trajectories: Trajectories, size: tuple[int, int]) -> Trajectories | None:
    """The trajectories with the rows put back; None: no rows swing. size: width and height, px."""
    frames = np.flatnonzero(trajectories.seen.any(axis=1))
    if len(frames) < _LEAST_FRAMES:
        return None
    moved = np.stack([apply(trajectories.shapes[f], trajectories.current_px[f]) for f in frames])
    seen = trajectories.seen[frames]
    steady = _steady(moved - trajectories.reference_px, seen, frames)
    usable = seen & (seen.mean(axis=0) >= _SEEN) & (steady.scatter_px < _STEADY_PX)
    bands = _Bands.of(trajectories, frames, usable, size)
    swing = bands.means(steady.residual)
    if not _swings(swing):
        return None
    back = bands.at_current(swing.mean(axis=1)) + bands.at_reference(steady.intercept)
    current = trajectories.current_px.copy()
    for k, f in enumerate(frames.tolist()):
        current[f] = apply(np.linalg.inv(trajectories.shapes[f]), moved[k] - back[k])
    return replace(trajectories, current_px=current)


@dataclass(frozen=True, eq=False)
class _Steady:
    """Residuals (F, N, 2) about a steady motion of each feature, its intercept (N, 2) and their RMS (N,), px."""

    residual: FloatArray
    intercept: FloatArray
    scatter_px: FloatArray


def _steady(off: FloatArray, seen: BoolArray, frames: IdArray) -> _Steady:
    """The regression of (F, N, 2) displacements over the frames in which each feature was seen, (F, N) bool."""
    time = (frames + 1.0)[:, None] * seen
    count = np.maximum(seen.sum(axis=0), 1)
    mean_time = time.sum(axis=0) / count
    mean_off = np.where(seen[..., None], off, 0.0).sum(axis=0) / count[:, None]
    apart_time = np.where(seen, time - mean_time, 0.0)
    apart = np.where(seen[..., None], off - mean_off, 0.0)
    slope = np.einsum("fn,fnd->nd", apart_time, apart) / np.maximum((apart_time**2).sum(axis=0), 1e-9)[:, None]
    residual = apart - apart_time[..., None] * slope
    scatter_px = np.sqrt((residual**2).sum(axis=(0, 2)) / count)
    return _Steady(residual, mean_off - slope * mean_time[:, None], scatter_px)


@dataclass(frozen=True, eq=False)
class _Bands:
    """cell: (F, N) int64, number of the frame, half of the strips and band; beyond the last where not usable.

    current_y, reference_y: in bands, (F, N) and (N,).
    """

    cell: IdArray
    usable: BoolArray
    current_y: FloatArray
    reference_y: FloatArray

    @staticmethod
    def of(trajectories: Trajectories, frames: IdArray, usable: BoolArray, size: tuple[int, int]) -> _Bands:
        current_y = trajectories.current_px[frames, :, 1] * (_BANDS / size[1])
        half = (trajectories.reference_px[:, 0] * (_STRIPS / size[0])).astype(int) % 2
        band = np.clip(current_y, 0, _BANDS - 1).astype(np.int64)
        cell = (np.arange(len(frames))[:, None] * 2 + half) * _BANDS + band
        return _Bands(np.where(usable, cell, len(frames) * 2 * _BANDS), usable, current_y,
                      trajectories.reference_px[:, 1] * (_BANDS / size[1]))

    def means(self, off: FloatArray) -> FloatArray:
        """(F, 2, bands, 2) means over frame, half and band of (F, N, 2); NaN where either half has too few."""
        cells = len(self.cell) * 2 * _BANDS
        count = np.bincount(self.cell.ravel(), minlength=cells + 1)[:cells]
        sums = np.stack([np.bincount(self.cell.ravel(), off[..., d].ravel(), cells + 1)[:cells] for d in range(2)], -1)
        mean = (sums / np.maximum(count, 1)[:, None]).reshape(-1, 2, _BANDS, 2)
        enough = count.reshape(-1, 2, _BANDS).min(axis=1) >= _LEAST_IN_BAND
        return np.where(enough[:, None, :, None], mean, np.nan)

    def at_current(self, by_band: FloatArray) -> FloatArray:
        """(F, N, 2) values at the features' rows in each frame of (F, bands, 2)."""
        return np.stack([_interpolated(values, y) for values, y in zip(by_band, self.current_y, strict=True)])

    def at_reference(self, off: FloatArray) -> FloatArray:
        """(N, 2) means over bands of the reference of the usable features' (N, 2)."""
        which = self.usable.any(axis=0)
        band = np.clip(self.reference_y[which], 0, _BANDS - 1).astype(np.int64)
        count = np.bincount(band, minlength=_BANDS)
        sums = np.stack([np.bincount(band, off[which, d], _BANDS) for d in range(2)], axis=-1)
        mean = np.where(count[:, None] >= _LEAST_IN_BAND, sums / np.maximum(count, 1)[:, None], np.nan)
        return _interpolated(mean, self.reference_y)


def _interpolated(by_band: FloatArray, y: FloatArray) -> FloatArray:
    """(n, 2) linear between the centres of bands (bands, 2), of which some are NaN."""
    known = np.flatnonzero(~np.isnan(by_band[:, 0]))
    if not len(known):
        return np.zeros((len(y), 2))
    return np.stack([np.interp(y, known + 0.5, by_band[known, d]) for d in range(2)], axis=1)


def _swings(swing: FloatArray) -> bool:
    """Whether both halves show the same, and more than one shape."""
    known = ~np.isnan(swing[:, 0, :, 0])
    if known.mean() < _LEAST_CELLS:
        return False
    halves = np.nan_to_num(swing)
    shared = (halves[:, 0] * halves[:, 1]).sum() / known.sum()
    one, other = (halves[:, k].transpose(0, 2, 1).reshape(-1, _BANDS) for k in range(2))
    return bool(shared > _SWING_PX**2) and independent_share(one, other) > INDEPENDENT
