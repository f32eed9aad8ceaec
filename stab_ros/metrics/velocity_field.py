"""Surface velocity field (SVF): residual motion of a stabilized image by sub-region.

Ljubicic et al. (2021, sections 2.5.1 and 3.1): vectors by FFT cross-correlation between the reference and a later
image, then the mean vector and mean magnitude of each sub-region. Opposite vectors cancel in the mean vector but not in
the magnitude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray
from stab_ros.metrics.correlation import MARGIN_PX, Correlator

_WINDOWS_PX = (64, 48, 32)  # the widest that fits into a sub-region, else the last
_PER_AXIS = 3  # largest number of areas per axis of a sub-region
_STEP_PX = 8  # spacing of the tested positions of an area
_GOOD_SHARE = 0.5  # share of the best texture in a cell that a position needs
_NEIGHBOURS = 8
_NOISE_FLOOR_PX = 0.2  # of the median test, added to the scatter of the neighbours
_OUTLIER = 4.0
_MIN_GATE_PX, _GATE_PX = 0.15, 1.0  # range of the threshold on residuals from the ground plane
_GATE_SCATTERS = 4.0  # threshold in units of the median residual, which includes the relief of the ground


@dataclass(frozen=True)
class RegionVelocity:
    """Residual motion of one sub-region.

    Attributes:
        region: number of the sub-region, in row-major order.
        x_px, y_px: its centre.
        u_px, v_px: mean vector; NaN without vectors.
        magnitude_px: mean length; NaN without vectors.
        vectors: number of vectors.
    """

    region: int
    x_px: float
    y_px: float
    u_px: float
    v_px: float
    magnitude_px: float
    vectors: int


@dataclass(frozen=True, eq=False)
class Field:
    """The vectors of one image, or their mean over several.

    Attributes:
        centres_px: (n, 2) centres of the areas.
        shifts_px: (n, 2) displacements of their content; NaN where not known.
        region: (n,) int64, number of each area's sub-region.
        regions: the sub-regions.
    """

    centres_px: FloatArray
    shifts_px: FloatArray
    region: IdArray
    regions: tuple[RegionVelocity, ...]

    def __post_init__(self) -> None:
        if self.centres_px.shape != self.shifts_px.shape or self.centres_px.shape[1:] != (2,):
            raise ValueError(f"centres of {self.centres_px.shape} and shifts of {self.shifts_px.shape}, "
                             "both must be (n, 2)")


class VelocityField:
    """Measures the velocity field against one reference in columns x rows equal sub-regions.

    Each sub-region has up to nine areas: the best-textured ones, spread evenly, that lie completely in `allowed`.
    """

    def __init__(self, reference: Gray, allowed: BoolArray, columns: int, rows: int) -> None:
        """Places the areas.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where static ground may be.
            columns: number of columns of sub-regions.
            rows: number of rows.

        Raises:
            ValueError: `allowed` differs in shape, or there are no columns or rows.
        """
        if allowed.shape != reference.shape or min(columns, rows) < 1:
            raise ValueError(f"{columns}x{rows} sub-regions of {reference.shape} with a mask of {allowed.shape}: "
                             "there must be at least one, and the mask must have the image's shape")
        boxes = _boxes(reference.shape, columns, rows)
        window_px = _window_px(reference.shape, boxes)
        quality = _quality(reference, allowed, window_px)
        placed = [_place_areas(quality, box, window_px) for box in boxes]
        self._middles_px = [((left + right - 1) / 2, (top + bottom - 1) / 2) for left, top, right, bottom in boxes]
        self._region = np.repeat(np.arange(len(boxes)), [len(places) for places in placed])
        self._correlator = Correlator(reference, np.concatenate(placed), window_px)

    def measure(self, current: Gray, valid: BoolArray, ref_H_cur: Homography | None = None) -> Field:
        """The velocity field of an image.

        Args:
            current: (h, w) uint8.
            valid: (h, w) bool, valid part of `current`; areas that are not completely inside are not used.
            ref_H_cur: homography of the ground plane, if known; vectors that do not follow it are water.

        Raises:
            ValueError: an image or mask that differs in shape from the reference.
        """
        centres = self._correlator.areas_px.astype(np.float64)
        shifts = _without_outliers(centres, self._correlator.shifts(current, valid=valid))
        if ref_H_cur is not None:
            shifts[_on_water(_plane_residuals_px(centres, shifts, ref_H_cur))] = np.nan
        return Field(centres, shifts, self._region, tuple(
            _region_velocity(i, middle, shifts[self._region == i]) for i, middle in enumerate(self._middles_px)
        ))


def mean_field(fields: Sequence[Field]) -> Field:
    """The mean over images of one reference, with equal weight for each vector.

    Areas that are found in no more than half of the images are left out, because they are water.

    Raises:
        ValueError: no fields, or fields with different areas.
    """
    if len({field.centres_px.tobytes() for field in fields}) != 1:
        raise ValueError(f"{len(fields)} fields to average, there must be some and all with the same areas")
    first, shifts = fields[0], np.stack([field.shifts_px for field in fields])
    found = np.isfinite(shifts[:, :, 0])
    ground = 2 * found.sum(axis=0) > len(fields)
    shifts[:, ~ground] = np.nan
    mean = np.full(first.shifts_px.shape, np.nan)
    mean[ground] = np.nanmean(shifts[:, ground], axis=0)
    return Field(first.centres_px, mean, first.region, tuple(
        _region_velocity(one.region, (one.x_px, one.y_px), shifts[:, first.region == one.region].reshape(-1, 2))
        for one in first.regions
    ))


def _region_velocity(region: int, middle_px: tuple[float, float], shifts_px: FloatArray) -> RegionVelocity:
    found = shifts_px[np.isfinite(shifts_px[:, 0])]
    if not len(found):
        return RegionVelocity(region, *middle_px, np.nan, np.nan, np.nan, 0)
    (u, v), magnitude = found.mean(axis=0), np.hypot(*found.T).mean()
    return RegionVelocity(region, *middle_px, float(u), float(v), float(magnitude), len(found))


def _without_outliers(centres_px: FloatArray, shifts_px: FloatArray) -> FloatArray:
    """`shifts_px`, NaN for outliers of the normalized median test (Westerweel and Scarano 2005)."""
    known = np.flatnonzero(np.isfinite(shifts_px[:, 0]))
    if len(known) <= _NEIGHBOURS:
        return shifts_px.copy()
    places, vectors = centres_px[known], shifts_px[known]
    distance = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    near = vectors[np.argsort(distance, axis=1, kind="stable")[:, 1 : _NEIGHBOURS + 1]]
    middle = np.median(near, axis=1)
    scatter = np.median(np.abs(near - middle[:, None]), axis=1)
    bad = np.any(np.abs(vectors - middle) > _OUTLIER * (scatter + _NOISE_FLOOR_PX), axis=1)
    kept = shifts_px.copy()
    kept[known[bad]] = np.nan
    return kept


def _on_water(residual_px: FloatArray) -> BoolArray:
    """(n,) bool: areas with larger residuals from the ground plane (n,) than the relief explains."""
    near = residual_px[residual_px <= _GATE_PX]
    gate_px = np.clip(_GATE_SCATTERS * np.median(near), _MIN_GATE_PX, _GATE_PX) if len(near) else _GATE_PX
    return np.asarray(residual_px > gate_px)


def _plane_residuals_px(centres_px: FloatArray, shifts_px: FloatArray, ref_H_cur: Homography) -> FloatArray:
    """Residuals (n,) of the displacements from those of the plane, px; NaN without a displacement."""
    return np.asarray(np.hypot(*(centres_px + shifts_px - apply(np.linalg.inv(ref_H_cur), centres_px)).T))


def _boxes(shape: tuple[int, ...], columns: int, rows: int) -> list[tuple[int, int, int, int]]:
    """Left, top, right and bottom (exclusive) of the sub-regions, px, row by row."""
    x = np.round(np.linspace(0, shape[1], columns + 1)).astype(int).tolist()
    y = np.round(np.linspace(0, shape[0], rows + 1)).astype(int).tolist()
    return [(x[j], y[i], x[j + 1], y[i + 1]) for i in range(rows) for j in range(columns)]


def _window_px(shape: tuple[int, ...], boxes: Sequence[tuple[int, int, int, int]]) -> int:
    """The widest window that fits into the sub-regions and the image, else the narrowest."""
    left, top, right, bottom = boxes[0]
    room = min(right - left, bottom - top, min(shape) - 2 * MARGIN_PX)
    return next((window for window in _WINDOWS_PX if window <= room), _WINDOWS_PX[-1])


def _quality(reference: Gray, allowed: BoolArray, window_px: int) -> FloatArray:
    """Smaller eigenvalue (h, w) of the structure tensor of an area centred at each pixel; 0 where it is not allowed."""
    area = np.ones((window_px, window_px), np.uint8)
    whole = cv2.erode(allowed.astype(np.uint8), area)
    reach = window_px // 2 + MARGIN_PX
    whole[:reach], whole[-reach + 1 :], whole[:, :reach], whole[:, -reach + 1 :] = 0, 0, 0, 0
    smooth = cv2.GaussianBlur(reference, (0, 0), 1.0)
    return np.asarray(cv2.cornerMinEigenVal(smooth, window_px) * whole)


def _place_areas(quality: FloatArray, box: tuple[int, int, int, int], window_px: int) -> IdArray:
    """Centres (k, 2) of the areas of one sub-region, the best of each cell; `quality` is set to 0 around them."""
    left, top, right, bottom = box
    half, places = window_px // 2, []
    x, y = _cell_edges(left, right, half), _cell_edges(top, bottom, half)
    for (y0, y1), (x0, x1) in product(pairwise(y), pairwise(x)):
        cell = quality[y0:y1:_STEP_PX, x0:x1:_STEP_PX]
        if cell.any():
            row, column = np.nonzero(cell >= _GOOD_SHARE * cell.max())
            x_px, y_px = x0 + _STEP_PX * column, y0 + _STEP_PX * row
            best = np.argmin(np.hypot(2 * x_px - x0 - x1, 2 * y_px - y0 - y1))
            places.append((x_px[best], y_px[best]))
            rows, columns = (slice(at[best] - half, at[best] + half) for at in (y_px, x_px))
            quality[rows, columns] = 0  # areas overlap by half at most
    return np.array(places, np.int64).reshape(-1, 2)


def _cell_edges(low: int, high: int, smallest: int) -> list[int]:
    """Edges of the cells, one per area, into which a sub-region's span is divided."""
    count = min(_PER_AXIS, max(1, (high - low) // smallest))
    return [low + i * (high - low) // count for i in range(count + 1)]
