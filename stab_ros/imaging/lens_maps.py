"""Where the pixels of a result lie in the picture of a lens: tables for `cv2.remap`.

Exact ones have a place for every pixel. Quick ones are exact at three places of each block of a row and quadratic in
between; where that is off by more than 0.003 px, in each half of it, or pixel by pixel. They hold steps of 1/32 px, by
which OpenCV interpolates, so that `cv2.remap` need not convert them.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.kernels import F32, F64, I32, I64, U16, filled, inlined, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray, Homography
from stab_ros.imaging.lens import Lens

RemapTables: TypeAlias = tuple[FloatArray, FloatArray]  # x and y, (h, w) float32, for cv2.remap
QuickTables: TypeAlias = tuple[NDArray[np.int16], NDArray[np.uint16]]  # whole px (h, w, 2) and shares (h, w), as above

MOST_PX = 32_000  # of a side of the picture, for quick tables
_STEPS, _STEP_BITS, _SHARE = 32, np.int32(5), np.int32(31)  # of a pixel, in quick tables: 5 bits
_HALF, _LOWER = np.int32(16), np.int32(0xFFFF)  # of 32 bits
_BLOCK = 64  # px of a row
_TOLERANCE_PX = 0.003  # of a quadratic between three places, which leaves a cubic most about a quarter of the way
_OF_DIFFERENCE = 1 / 15.6  # its greatest error, as a share of the third difference of places half as far apart
_MIN_ROWS_PER_THREAD = 64
_INVALID_PX = np.float32(-1e6)  # outside every image
_FARTHEST_PX = np.float32(MOST_PX + 500)  # of places in quick tables: outside, and within 16 bits
_BEFORE_PX = np.float32(-500)


def lens_maps(lens: Lens, ray_M_pixel: Homography, size: tuple[int, int]) -> RemapTables:
    """Positions in the distorted image of each pixel of a result; far outside the image where there is none.

    Args:
        lens: tabulated model.
        ray_M_pixel: (3, 3), from pixels of the result to rays of the camera.
        size: width and height of the result, px.
    """
    x_px, y_px = np.empty((size[1], size[0]), np.float32), np.empty((size[1], size[0]), np.float32)
    _fill_maps(lens.scale, lens.reach2, lens.small_terms, lens.pixel_M_seen, ray_M_pixel, x_px, y_px)
    return x_px, y_px


def quick_lens_maps(lens: Lens, ray_M_pixel: Homography, size: tuple[int, int]) -> QuickTables:
    """As `lens_maps`, within 0.02 px along each axis, for pictures of up to `MOST_PX` a side."""
    places, shares = np.empty((size[1], size[0], 2), np.int16), np.empty((size[1], size[0]), np.uint16)
    packed = places.view(np.int32)[:, :, 0]

    def rows(first: int, last: int) -> None:
        _fill_quick(lens.scale, lens.reach2, lens.small_terms, lens.pixel_M_seen, ray_M_pixel, packed, shares, first,
                    last)

    in_parallel(rows, size[1], _MIN_ROWS_PER_THREAD)
    return places, shares


@inlined(fastmath=True)
def _place(scale: FloatArray, reach2: float, small_terms: FloatArray, M: FloatArray, A: Homography, column: float,
           row: float) -> Any:
    """X and y in the distorted image. scale, reach2, small_terms, M: of the lens. A: from pixels to rays."""
    depth = A[2, 0] * column + A[2, 1] * row + A[2, 2]
    k = 1 / max(depth, 1e-9)
    u = (A[0, 0] * column + A[0, 1] * row + A[0, 2]) * k
    v = (A[1, 0] * column + A[1, 1] * row + A[1, 2]) * k
    r2 = u * u + v * v
    seen = (depth > 1e-9) & (r2 < reach2)
    at = r2 * ((len(scale) - 1) / reach2) if seen else 0.0
    entry = int(at)
    radial = scale[entry] + (at - entry) * (scale[entry + 1] - scale[entry])
    p1, p2, s1, s2, s3, s4 = small_terms
    uv = 2 * u * v
    x = u * radial + p1 * uv + p2 * (r2 + 2 * u * u) + r2 * (s1 + s2 * r2)
    y = v * radial + p2 * uv + p1 * (r2 + 2 * v * v) + r2 * (s3 + s4 * r2)
    w = 1 / (M[2, 0] * x + M[2, 1] * y + M[2, 2])
    x_px = (M[0, 0] * x + M[0, 1] * y + M[0, 2]) * w if seen else float(_INVALID_PX)
    y_px = (M[1, 0] * x + M[1, 1] * y + M[1, 2]) * w if seen else float(_INVALID_PX)
    return x_px, y_px


@kernel((read(F64, 1), F64, read(F64, 1), read(F64, 2), read(F64, 2), filled(F32, 2), filled(F32, 2)), fastmath=True)
def _fill_maps(scale: FloatArray, reach2: float, small_terms: FloatArray, M: FloatArray, A: Homography,
               x_px: FloatArray, y_px: FloatArray) -> None:
    """Fills the maps. Arguments: as of `_place`."""
    for row in range(len(x_px)):
        for column in range(x_px.shape[1]):
            x, y = _place(scale, reach2, small_terms, M, A, column, row)
            x_px[row, column] = x
            y_px[row, column] = y


@kernel((read(F64, 1), F64, read(F64, 1), read(F64, 2), read(F64, 2), filled(I32, 2), filled(U16, 2), I64, I64),
        fastmath=True)
def _fill_quick(scale: FloatArray, reach2: float, small_terms: FloatArray, M: FloatArray, A: Homography,
                places: NDArray[np.int32], shares: NDArray[np.uint16], first: int, last: int) -> None:
    """Fills rows `first` to `last`. places: x in the lower 16 bits, y in the upper ones. Others: as of `_place`."""
    x_px, y_px = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    wide, whole, parts = places.shape[1], places.ravel(), shares.ravel()
    for row in range(first, last):
        x0, y0 = _place(scale, reach2, small_terms, M, A, 0, row)
        for start in range(0, wide, _BLOCK):
            near_x, near_y = _place(scale, reach2, small_terms, M, A, start + _BLOCK / 4, row)
            mid_x, mid_y = _place(scale, reach2, small_terms, M, A, start + _BLOCK / 2, row)
            x1, y1 = _place(scale, reach2, small_terms, M, A, start + _BLOCK, row)
            off_x, off_y = near_x - (3 * x0 + 6 * mid_x - x1) / 8, near_y - (3 * y0 + 6 * mid_y - y1) / 8
            far_x, far_y = x1, y1
            whole_block = max(abs(off_x), abs(off_y)) < _TOLERANCE_PX
            halves = False
            if not whole_block:
                far_x, far_y = _place(scale, reach2, small_terms, M, A, start + _BLOCK * 3 / 4, row)
                halves = max(_difference(x0, near_x, mid_x, far_x, x1), _difference(y0, near_y, mid_y, far_y, y1)) < (
                    _TOLERANCE_PX / _OF_DIFFERENCE)
            if whole_block:
                _fill_path(x_px, 0, _BLOCK, x0, mid_x, x1)
                _fill_path(y_px, 0, _BLOCK, y0, mid_y, y1)
            elif halves:
                _fill_path(x_px, 0, _BLOCK // 2, x0, near_x, mid_x)
                _fill_path(y_px, 0, _BLOCK // 2, y0, near_y, mid_y)
                _fill_path(x_px, _BLOCK // 2, _BLOCK // 2, mid_x, far_x, x1)
                _fill_path(y_px, _BLOCK // 2, _BLOCK // 2, mid_y, far_y, y1)
            else:
                for k in range(_BLOCK):
                    x, y = _place(scale, reach2, small_terms, M, A, start + k, row)
                    x_px[k] = x
                    y_px[k] = y
            for k in range(np.uint64(min(_BLOCK, wide - start))):
                x_steps, y_steps = _in_steps(x_px[k]), _in_steps(y_px[k])
                at = np.uint64(row * wide + start) + k
                whole[at] = (x_steps >> _STEP_BITS) & _LOWER | (y_steps >> _STEP_BITS) << _HALF
                parts[at] = (y_steps & _SHARE) << _STEP_BITS | (x_steps & _SHARE)
            x0, y0 = x1, y1


@inlined(fastmath=True)
def _difference(a: float, b: float, c: float, d: float, e: float) -> float:
    """The greater third difference of five places in a row."""
    return max(abs(d - 3 * c + 3 * b - a), abs(e - 3 * d + 3 * c - b))


@inlined(fastmath=True)
def _fill_path(places: FloatArray, begin: int, length: int, start: float, middle: float, end: float) -> None:
    """Fills pixels with the quadratic through the place of the first, of their middle and of the one after the last."""
    first, step = np.float32(start), np.float32((end - start) / length)
    bend, at = np.float32((2 * middle - start - end) * 2 / length**2), np.uint64(begin)
    for k in range(np.uint64(length)):
        place = np.float32(k)
        places[at + k] = first + step * place + bend * place * (np.float32(length) - place)


@inlined(fastmath=True)
def _in_steps(place_px: Any) -> Any:
    """A place in whole steps, int32; within 16 bits of pixels."""
    after_px = min(max(place_px, _BEFORE_PX), _FARTHEST_PX) - _BEFORE_PX
    return np.int32(after_px * np.float32(_STEPS) + np.float32(0.5)) + np.int32(_BEFORE_PX * _STEPS)
