"""Which corners are followed: the strongest, or the best of each cell of an even grid on the water."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, Gray, IdArray
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import place_derivatives, places_of
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.settings import VelocityConfig

_CORNER_PX = 5  # window of the minimum eigenvalue, as of KLT-IV's detector
_DARK = float(np.finfo(np.float32).tiny)
_CANDIDATES = 8  # for each feature, before they are thinned out to an even density


def seeds(frame: PlacedFrame, water: PlaneMask | None, config: VelocityConfig) -> FloatArray:
    """Pixels (n, 2) as taken of the features of an interval, n up to `features`.

    Args:
        frame: in which they begin.
        water: where on the plane they may begin; None: everywhere.
        config: number, selection, borders.
    """
    strength: FloatArray = np.asarray(cv2.cornerMinEigenVal(frame.gray, _CORNER_PX))
    side = _candidate_side(frame.gray, config)
    corners, score = _best_of_cells(strength, _inner(frame.gray.shape, config), side)
    places_m = places_of(frame, corners)
    shown = np.asarray(np.isfinite(places_m).all(axis=1))
    if water is not None:
        shown &= water.holds(places_m)
    shown &= score >= max(config.min_quality * float(score[shown].max(initial=0)), _DARK)
    corners, score, places_m = corners[shown], score[shown], places_m[shown]
    if config.selection == "even":
        return np.asarray(corners[_evenly(frame, corners, score, places_m, side, config.features)])
    return np.asarray(corners[np.sort(np.argsort(-score, kind="stable")[: config.features])])


def _inner(shape: tuple[int, ...], config: VelocityConfig) -> tuple[slice, slice]:
    """Rows and columns in which features may begin: their windows lie inside the image."""
    margins = [max(round(config.ignore_edges * n), config.block_px // 2 + 2) for n in shape]
    rows, columns = (slice(margin, max(n - margin, margin)) for n, margin in zip(shape, margins, strict=True))
    return rows, columns


def _candidate_side(gray: Gray, config: VelocityConfig) -> int:
    """Side of the cells of which the best pixel is a candidate, px."""
    many = config.features * _CANDIDATES
    return int(np.clip(np.sqrt(gray.size / many), _CORNER_PX, config.block_px))


def _best_of_cells(strength: FloatArray, inner: tuple[slice, slice], side: int) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of the largest strength of each whole cell of side x side px, and the strength (n,) there."""
    part = strength[inner]
    rows, columns = (n // side for n in part.shape)
    blocks = part[: rows * side, : columns * side].reshape(rows, side, columns, side)
    cells = blocks.transpose(0, 2, 1, 3).reshape(rows * columns, side * side)
    best = cells.argmax(axis=1) if cells.size else np.zeros(0, np.int64)
    number = np.arange(rows * columns)
    x = inner[1].start + number % max(columns, 1) * side + best % side
    y = inner[0].start + number // max(columns, 1) * side + best // side
    return np.stack([x, y], axis=1).astype(float), cells[number, best]


def _evenly(frame: PlacedFrame, corners: FloatArray, score: FloatArray, places_m: FloatArray, side: int,
            count: int) -> IdArray:
    """Indices of the strongest corner of each cell of a grid on the plane, at most `count`, in their order."""
    if not len(corners):
        return np.zeros(0, np.int64)
    area_m2 = side**2 * np.abs(np.linalg.det(place_derivatives(frame, corners)[0]))
    cell_m = np.sqrt(area_m2.sum() / count)
    cell = np.floor((places_m - places_m.min(axis=0)) / cell_m).astype(np.int64)
    order = np.argsort(-score, kind="stable")
    _, first = np.unique(cell[order], axis=0, return_index=True)
    chosen = order[np.sort(first)][:count]
    return np.sort(chosen)
