"""Bilinear resampling by a homography near the identity, as for a hovering camera.

For such a homography, long runs of a row of the result are read from a single row of the source. Blocks of a row are
interpolated with contiguous loads and linearly increasing fractions, which compilers vectorize. OpenCV instead gathers
four neighbours for every pixel. Source positions are exact at both ends of a block and quadratic in between.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stab_ros.core.kernels import F32, F64, I64, U8, U16, filled, inlined, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray, Homography, Image

_LONG, _SHORT = 64, 16  # block lengths, px; short ones where long ones are not applicable
_MAX_SLOPE = 0.65 / _SHORT  # largest deviation of the Jacobian from the identity; above, OpenCV is faster
_MAX_DEPTH_CHANGE = 0.01  # relative, along a block; position errors grow with its square, to 0.002 px
_MIN_ROWS_PER_THREAD = 64


def is_resampled(image: Image) -> bool:
    """Whether `resample` takes images of this dtype and layout."""
    return image.flags.c_contiguous and image.dtype in (np.uint8, np.uint16)


def is_gentle(ref_H_cur: Homography, size: tuple[int, int]) -> bool:
    """Whether `resample` is exact, and faster than OpenCV, for a result of `size` (width, height)."""
    cur_M_ref = np.linalg.inv(ref_H_cur)
    x, y = np.meshgrid([0.0, size[0] - 1.0], [0.0, size[1] - 1.0])
    places = cur_M_ref @ np.stack([x.ravel(), y.ravel(), np.ones(4)])
    depth = places[2]
    if not (np.isfinite(places).all() and depth.min() > 0):
        return False
    along = (cur_M_ref[:2, 0, None] - places[:2] / depth * cur_M_ref[2, 0]) / depth
    depth_change = _LONG * abs(cur_M_ref[2, 0]) / depth.min()
    return bool(np.abs(along - [[1.0], [0.0]]).max() < _MAX_SLOPE and depth_change < _MAX_DEPTH_CHANGE)


def resample(image: Image, ref_H_cur: Homography, out: Image) -> None:
    """Fills `out` with `image` warped by `ref_H_cur`, bilinearly; 0 outside the image. `is_gentle` must hold.

    Args:
        image: (h, w) or (h, w, channels), uint8 or uint16, C-contiguous.
        ref_H_cur: (3, 3).
        out: the same number of channels and dtype, C-contiguous.
    """
    channels = 1 if image.ndim == 2 else image.shape[2]
    pixels, result = image.reshape(len(image), -1), out.reshape(len(out), -1)
    pixel_of = np.repeat(np.arange(_LONG, dtype=np.float32), channels)
    cur_M_ref = np.linalg.inv(ref_H_cur)

    def rows(first: int, last: int) -> None:
        _resample(pixels, cur_M_ref, result, pixel_of, channels, first, last)

    in_parallel(rows, len(out), _MIN_ROWS_PER_THREAD)


# The functions below are inlined, so that the compiler knows the block lengths and vectorizes the loops.
@kernel(*((read(value, 2), read(F64, 2), filled(value, 2), read(F32, 1), I64, I64, I64) for value in (U8, U16)),
        fastmath=True)
def _resample(image: Image, M: Homography, out: Image, pixel_of: FloatArray, channels: int, first: int,
              last: int) -> None:
    """Fills rows `first` to `last` of the result; images are (h, w * channels).

    pixel_of: pixel of a block to which each of its values belongs.
    """
    shape = image.shape
    wide, pixels, result = out.shape[1] // channels, image.ravel(), out.ravel()
    for y in range(first, last):
        for block in range(0, wide, _LONG):
            start = min(block, wide - _LONG)  # the last block overlaps the previous one
            if start < 0:
                _pixel_by_pixel(image, M, out, channels, 0, wide, y)
                continue
            x0, y0, depth = _source_position(M, start, y)
            x1, y1, end_depth = _source_position(M, start + _LONG, y)
            to, depth_change = (y * wide + start) * channels, end_depth / depth - 1
            if (_within_rows(pixels, shape, result, to, pixel_of, channels, _LONG, x0, y0, x1, y1, depth_change) or
                    _across_rows(pixels, shape, result, to, pixel_of, channels, _LONG, x0, y0, x1, y1, depth_change)):
                continue
            for part in range(0, _LONG, _SHORT):
                end = part + _SHORT
                a, b = _source_share(part / _LONG, depth_change), _source_share(end / _LONG, depth_change)
                if not _across_rows(pixels, shape, result, to + part * channels, pixel_of, channels, _SHORT,
                                 x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0),
                                 depth_change * _SHORT / _LONG):
                    _pixel_by_pixel(image, M, out, channels, start + part, start + end, y)


@inlined(fastmath=True)
def _source_position(M: Homography, x: float, y: float) -> Any:
    """Source position and depth of a pixel of the result."""
    depth = M[2, 0] * x + M[2, 1] * y + M[2, 2]
    inverse = 1 / depth
    return (M[0, 0] * x + M[0, 1] * y + M[0, 2]) * inverse, (M[1, 0] * x + M[1, 1] * y + M[1, 2]) * inverse, depth


@inlined(fastmath=True)
def _source_share(s: float, depth_change: float) -> Any:
    """Share of a block's source path that corresponds to the share `s` of the block in the result.

    s (1 + depth_change) / (1 + s depth_change), to second order.
    """
    return s + depth_change * s * (1 - s)


@inlined(fastmath=True)
def _block_path(length: int, x0: float, y0: float, x1: float, y1: float, depth_change: float) -> Any:
    """Source path of a block: steps and second-order terms in x and y, first column and row, number of crossings.

    A crossing is a change of the source row, or of the column relative to the pixel's position in the block.
    """
    x_step, y_step = (x1 - x0) / length, (y1 - y0) / length
    x_bend, y_bend = depth_change * x_step / length, depth_change * y_step / length
    x_sag, y_sag = abs(x_bend) * length**2 / 4, abs(y_bend) * length**2 / 4
    column, row = np.floor(min(x0, x1 - length) - x_sag), np.floor(min(y0, y1) - y_sag)
    crossed = max(np.floor(max(x0, x1 - length) + x_sag) - column, np.floor(max(y0, y1) + y_sag) - row)
    return x_step, y_step, x_bend, y_bend, int(column), int(row), int(crossed)


@inlined(fastmath=True)
def _contains(shape: tuple[int, int], channels: int, column: int, row: int, columns: int, rows: int) -> bool:
    """Whether the image contains `columns` x `rows` pixels from (column, row) on."""
    return column >= 0 and row >= 0 and (column + columns) * channels <= shape[1] and row + rows <= shape[0]


# Indices are unsigned, because numba checks each signed one for wraparound.
@inlined(fastmath=True)
def _within_rows(pixels: Image, shape: tuple[int, int], result: Image, to: int, pixel_of: FloatArray, channels: int,
            length: int, x0: float, y0: float, x1: float, y1: float, depth_change: float) -> bool:
    """Fills a block whose source path crosses no row or column; False if it does.

    x0, y0: source position of its first pixel. x1, y1: of the pixel after its last. depth_change: see `_source_share`.
    """
    x_step, y_step, x_bend, y_bend, column, row, crossed = _block_path(length, x0, y0, x1, y1, depth_change)
    if crossed > 0 or not _contains(shape, channels, column, row, length + 1, 2):
        return False
    at, into = np.uint64(row * shape[1] + column * channels), np.uint64(to)
    right, down, whole = np.uint64(channels), np.uint64(shape[1]), np.float32(length)
    fx0, fx_step, fx_bend = np.float32(x0 - column), np.float32(x_step - 1), np.float32(x_bend)
    fy0, fy_step, fy_bend = np.float32(y0 - row), np.float32(y_step), np.float32(y_bend)
    for k in range(np.uint64(length * channels)):
        p = pixel_of[k]
        curve = p * (whole - p)
        fx, fy = fx0 + fx_step * p + fx_bend * curve, fy0 + fy_step * p + fy_bend * curve
        a, b = np.float32(pixels[at + k]), np.float32(pixels[at + k + right])
        c, d = np.float32(pixels[at + down + k]), np.float32(pixels[at + down + k + right])
        upper, lower = a + fx * (b - a), c + fx * (d - c)
        result[into + k] = np.int32(upper + fy * (lower - upper) + np.float32(0.5))
    return True


@inlined(fastmath=True)
def _across_rows(pixels: Image, shape: tuple[int, int], result: Image, to: int, pixel_of: FloatArray,
              channels: int, length: int, x0: float, y0: float, x1: float, y1: float, depth_change: float) -> bool:
    """As `_within_rows`, for a path with at most one crossing: interpolates in three rows and columns."""
    x_step, y_step, x_bend, y_bend, column, row, crossed = _block_path(length, x0, y0, x1, y1, depth_change)
    if crossed > 1 or not _contains(shape, channels, column, row, length + 2, 3):
        return False
    at, into = np.uint64(row * shape[1] + column * channels), np.uint64(to)
    right, down, whole = np.uint64(channels), np.uint64(shape[1]), np.float32(length)
    fx0, fx_step, fx_bend = np.float32(x0 - column), np.float32(x_step - 1), np.float32(x_bend)
    fy0, fy_step, fy_bend = np.float32(y0 - row), np.float32(y_step), np.float32(y_bend)
    zero, one = np.float32(0), np.float32(1)
    for k in range(np.uint64(length * channels)):
        p = pixel_of[k]
        curve = p * (whole - p)
        fx, fy = fx0 + fx_step * p + fx_bend * curve, fy0 + fy_step * p + fy_bend * curve
        beyond_x, beyond_y = max(fx - one, zero), max(fy - one, zero)
        fx, fy = min(fx, one), min(fy, one)
        upper = _interpolate(pixels, at + k, right, fx, beyond_x)
        middle = _interpolate(pixels, at + down + k, right, fx, beyond_x)
        lower = _interpolate(pixels, at + down + down + k, right, fx, beyond_x)
        result[into + k] = np.int32(upper + fy * (middle - upper) + beyond_y * (lower - middle) + np.float32(0.5))
    return True


@inlined(fastmath=True)
def _interpolate(pixels: Image, at: int, right: int, fx: float, beyond: float) -> Any:
    """Linear interpolation by `fx` from a pixel to the next one, and by `beyond` from there to the one after."""
    a, b, c = np.float32(pixels[at]), np.float32(pixels[at + right]), np.float32(pixels[at + right + right])
    return a + fx * (b - a) + beyond * (c - b)


@inlined(fastmath=True)
def _pixel_by_pixel(image: Image, M: Homography, out: Image, channels: int, start: int, end: int,
                y: int) -> None:
    """Fills pixels near and outside the border of the image, which is 0 outside."""
    height, width = image.shape[0], image.shape[1] // channels
    for x in range(start, end):
        x_px, y_px, _depth = _source_position(M, x, y)
        column, row = int(np.floor(x_px)), int(np.floor(y_px))
        fx, fy = x_px - column, y_px - row
        for channel in range(channels):
            value = 0.0
            if -1 <= column < width and -1 <= row < height:
                for dy in range(2):
                    for dx in range(2):
                        if 0 <= row + dy < height and 0 <= column + dx < width:
                            weight = (fy if dy else 1 - fy) * (fx if dx else 1 - fx)
                            value += weight * image[row + dy, (column + dx) * channels + channel]
            out[y, x * channels + channel] = np.int32(value + 0.5)
