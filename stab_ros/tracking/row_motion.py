"""Rows that swing during the start-up: found in the trajectories before planes are, and taken out of them.

Each feature may move steadily (water) or rest (ground). What the features of a row share beyond that, in one frame
and not in the next, is the rolling shutter. What they share in all frames after the reference, from the first on, is
that of the reference itself. Once a plane is known, its features alone tell how the rows lie, and which of the other
features belong to it as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, IdArray
from stab_ros.estimation import estimators
from stab_ros.estimation.rows import RowFit, changing_share, fit_rows, independent_share
from stab_ros.tracking.feature_tracks import Trajectories
from stab_ros.tracking.planes import THRESHOLD_PX, Plane, persistent

_BANDS = 32
_STRIPS = 8
_LEAST_FRAMES, _SEEN = 8, 0.75
_LEAST_IN_BAND, _LEAST_CELLS = 3, 0.3  # of the bands of all frames
_STEADY_PX = 2.5  # RMS about a steady motion: the rest is foam and leaves
_SWING_PX = 0.06  # RMS of what both halves of the strips show alike and no single shape explains
_INDEPENDENT = 0.12  # share of that
_CHANGING = 0.5  # from frame to frame, of what unrelated frames would change
_SHAPE_PX = 12.0
_LEFT_SHARE = 0.5  # of the swing, that looks like a steady motion over so few frames
_NOISE_PX = 0.1  # of a feature's place


@dataclass(frozen=True, eq=False)
class Straightened:
    """Trajectories with the rows put back. threshold_px: for planes, since a part of the swing is left in them."""

    trajectories: Trajectories
    threshold_px: float


def without_rows(trajectories: Trajectories, size: tuple[int, int]) -> Straightened | None:
    """The trajectories with the rows put back; None: no rows swing. size: width and height, px."""
    frames = np.flatnonzero(trajectories.seen.any(axis=1))
    if len(frames) < _LEAST_FRAMES:
        return None
    first = _Swing.of(trajectories, frames, size)
    if first.shared < _SWING_PX**2:
        return None
    trajectories = replace(trajectories, shapes=_wide_shapes(trajectories))
    swing = _Swing.of(trajectories, frames, size)
    if not swing.is_by_rows:
        return None
    return _straightened(trajectories, frames, swing, size)


def _straightened(trajectories: Trajectories, frames: IdArray, swing: _Swing, size: tuple[int, int]) -> Straightened:
    """The trajectories with the rows of each frame, and those of the reference, put back."""
    moved, steady, usable = swing.moved_px, swing.steady, swing.usable
    seen = np.asarray(usable.any(axis=0))
    own = _rows_of(trajectories.reference_px, trajectories.reference_px + steady.intercept, seen, size)
    current = trajectories.current_px.copy()
    for k, f in enumerate(frames.tolist()):
        shape, expected = trajectories.shapes[f], moved[k] - steady.residual[k]
        rows = _rows_of(apply(np.linalg.inv(shape), expected), current[f], usable[k], size)
        back = moved[k] if rows is None else apply(shape, current[f] + rows.at(current[f][:, 1]))
        back = back if own is None else back + own.at(trajectories.reference_px[:, 1])
        current[f] = apply(np.linalg.inv(shape), back)
    swing_px = float(np.sqrt(np.mean(np.sum((current - trajectories.current_px)[frames] ** 2, axis=-1))))
    return Straightened(replace(trajectories, current_px=current), THRESHOLD_PX + _LEFT_SHARE * swing_px)


def _wide_shapes(trajectories: Trajectories) -> FloatArray:
    """(F, 3, 3) rough ref_H_cur of each frame, fitted to rows that swing by more than those of `trajectories` allow."""
    shapes = trajectories.shapes.copy()
    for f in np.flatnonzero(trajectories.seen.any(axis=1)).tolist():
        pairs = trajectories.pairs(f)
        alike = replace(pairs, information=np.tile(np.eye(2), (len(pairs), 1, 1)))
        found = estimators.refine(alike, "projective", _SHAPE_PX, shapes[f], np.ones(len(pairs)))
        shapes[f] = shapes[f] if found is None else found
    return shapes


def regrown(plane: Plane, trajectories: Trajectories, size: tuple[int, int]) -> Plane:
    """The plane with all features that move with it once the rows are put back. size: width and height, px."""
    frames, fits = range(len(trajectories.shapes)), []
    for f in frames:
        pairs = trajectories.pairs(f)
        guess = trajectories.shapes[f] if np.isnan(plane.ref_H_cur[f, 0, 0]) else plane.ref_H_cur[f]
        fits.append(fit_rows(pairs, plane.member[pairs.feature_id].astype(float), "projective", THRESHOLD_PX, guess,
                             size))
    current = np.stack([_straight(trajectories.current_px[f], fit) for f, fit in zip(frames, fits, strict=True)])
    found = np.stack([np.full((3, 3), np.nan) if fit is None else fit.fit.ref_H_cur for fit in fits])
    if np.isnan(found[:, 0, 0]).all():
        return plane
    member = persistent(replace(trajectories, current_px=current), found, THRESHOLD_PX)
    return Plane(member | plane.member, np.where(np.isnan(found), plane.ref_H_cur, found))


def _straight(current_px: FloatArray, fit: RowFit | None) -> FloatArray:
    rows = None if fit is None else fit.fit.rows
    return current_px if rows is None else current_px + rows.at(current_px[:, 1])


def _rows_of(reference_px: FloatArray, current_px: FloatArray, usable: BoolArray,
             size: tuple[int, int]) -> RowShifts | None:
    """Displacements of the rows of current_px (N, 2), whose usable features belong at reference_px but for a plane."""
    which = np.flatnonzero(usable)
    pairs = Correspondences(which, reference_px[which], current_px[which],
                            np.tile(np.eye(2) / _NOISE_PX**2, (len(which), 1, 1)))
    found = fit_rows(pairs, np.ones(len(which)), "projective", THRESHOLD_PX, np.eye(3), size)
    return found.fit.rows if found is not None and found.holds else None


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


def _band_means(trajectories: Trajectories, frames: IdArray, usable: BoolArray, off_px: FloatArray,
                size: tuple[int, int]) -> FloatArray:
    """(F, 2, bands, 2) means of (F, N, 2) over bands of rows of both halves of the strips; NaN where these are few."""
    half = (trajectories.reference_px[:, 0] * (_STRIPS / size[0])).astype(int) % 2
    band = np.clip(trajectories.current_px[frames, :, 1] * (_BANDS / size[1]), 0, _BANDS - 1).astype(np.int64)
    cells = len(frames) * 2 * _BANDS
    cell = np.where(usable, (np.arange(len(frames))[:, None] * 2 + half) * _BANDS + band, cells).ravel()
    count = np.bincount(cell, minlength=cells + 1)[:cells]
    sums = np.stack([np.bincount(cell, off_px[..., d].ravel(), cells + 1)[:cells] for d in range(2)], axis=-1)
    mean = (sums / np.maximum(count, 1)[:, None]).reshape(-1, 2, _BANDS, 2)
    enough = count.reshape(-1, 2, _BANDS).min(axis=1) >= _LEAST_IN_BAND
    return np.where(enough[:, None, :, None], mean, np.nan)


def _without_plane(halves: FloatArray, known: BoolArray) -> FloatArray:
    """(2, bands, 2) means of one frame without their common slope, 0 where they are not known, (bands,) bool."""
    y = np.linspace(-1, 1, _BANDS)
    basis = np.stack([np.ones(_BANDS), y], axis=1) * known[:, None]
    mean = np.nan_to_num(halves).mean(axis=0)
    return np.asarray(np.nan_to_num(halves) - basis @ np.linalg.lstsq(basis, mean, rcond=None)[0])


@dataclass(frozen=True, eq=False)
class _Swing:
    """What moves unsteadily by rows.

    moved_px: (F, N, 2), the features in px of the reference. usable: (F, N) bool. halves: (2, F, bands, 2), mean
    residuals of both halves of the strips, 0 where either has few features. shared: mean product of both where known.
    """

    moved_px: FloatArray
    steady: _Steady
    usable: BoolArray
    halves: FloatArray
    shared: float

    @staticmethod
    def of(trajectories: Trajectories, frames: IdArray, size: tuple[int, int]) -> _Swing:
        moved = np.stack([apply(trajectories.shapes[f], trajectories.current_px[f]) for f in frames])
        seen = trajectories.seen[frames]
        steady = _steady(moved - trajectories.reference_px, seen, frames)
        usable = seen & (seen.mean(axis=0) >= _SEEN) & (steady.scatter_px < _STEADY_PX)
        means = _band_means(trajectories, frames, usable, steady.residual, size)
        known = ~np.isnan(means[:, 0, :, 0])
        halves = np.stack([_without_plane(one, which) for one, which in zip(means, known, strict=True)], axis=1)
        shared = float((halves[0] * halves[1]).sum()) / known.sum() if known.mean() >= _LEAST_CELLS else 0.0
        return _Swing(moved, steady, usable, halves, shared)

    @property
    def is_by_rows(self) -> bool:
        """Whether both halves show the same, more than one shape, and not the same in successive frames."""
        if self.shared <= 0:
            return False
        independent = independent_share(*self.halves)
        return (independent > _INDEPENDENT and self.shared * independent > _SWING_PX**2
                and changing_share(*self.halves) > _CHANGING)
