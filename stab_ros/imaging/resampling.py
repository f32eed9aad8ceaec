"""Bilinear resampling of a picture by a homography that is near the identity, as a camera that hovers makes them.

There the pixels of a row come from one row too, side by side, over long runs: blocks of a row are interpolated with
contiguous loads and fractions that grow evenly, which compilers turn into SIMD, where OpenCV gathers the four
neighbours of every pixel anew. Places are exact at both ends of a block, and a parabola in between.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stab_ros.core.kernels import F32, F64, I64, U8, U16, filled, inlined, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray, Homography, Image

_LONG, _SHORT = 64, 16  # px of a block; where the longer one will not do, the shorter may
_STEEPEST = 0.65 / _SHORT  # by how much a row, or a column, may drift off per px: beyond, OpenCV is quicker
_BENT = 0.01  # by how much the depth may change along a block, relatively: places are off by its square, 0.002 px
_LEAST_ROWS = 64  # that a thread is worth


def is_gentle(ref_H_cur: Homography, size: tuple[int, int]) -> bool:
    """Whether `resample` is the quicker way, and exact, for a result of `size` (width, height)."""
    cur_M_ref = np.linalg.inv(ref_H_cur)
    x, y = np.meshgrid([0.0, size[0] - 1.0], [0.0, size[1] - 1.0])
    places = cur_M_ref @ np.stack([x.ravel(), y.ravel(), np.ones(4)])
    depth = places[2]
    if not (np.isfinite(places).all() and depth.min() > 0):
        return False
    along = (cur_M_ref[:2, 0, None] - places[:2] / depth * cur_M_ref[2, 0]) / depth
    bent = _LONG * abs(cur_M_ref[2, 0]) / depth.min()
    return bool(np.abs(along - [[1.0], [0.0]]).max() < _STEEPEST and bent < _BENT)


def resample(image: Image, ref_H_cur: Homography, out: Image) -> None:
    """Fills `out`, (h, w) or (h, w, channels), with `image` as seen from the reference; 0 beyond its border.

    Both C-contiguous and of one dtype, uint8 or uint16; `is_gentle` must hold.
    """
    channels = 1 if image.ndim == 2 else image.shape[2]
    pixels, made = image.reshape(len(image), -1), out.reshape(len(out), -1)
    place_of = np.repeat(np.arange(_LONG, dtype=np.float32), channels)
    cur_M_ref = np.linalg.inv(ref_H_cur)

    def rows(first: int, last: int) -> None:
        _resample(pixels, cur_M_ref, made, place_of, channels, first, last)

    in_parallel(rows, len(out), _LEAST_ROWS)


# All that is called below is inlined: what has a fixed length then, the compiler unrolls and turns into SIMD.
@kernel(*((read(value, 2), read(F64, 2), filled(value, 2), read(F32, 1), I64, I64, I64) for value in (U8, U16)),
        fastmath=True)
def _resample(image: Image, M: Homography, out: Image, place_of: FloatArray, channels: int, first: int,
              last: int) -> None:
    """Rows `first` to `last` of the result; pictures are (h, w * channels).

    place_of: which pixel of a block each of its values belongs to.
    """
    shape = image.shape
    wide, pixels, made = out.shape[1] // channels, image.ravel(), out.ravel()
    for y in range(first, last):
        for block in range(0, wide, _LONG):
            start = min(block, wide - _LONG)  # the last one overlaps the one before
            if start < 0:
                _one_by_one(image, M, out, channels, 0, wide, y)
                continue
            x0, y0, depth = _place(M, start, y)
            x1, y1, deeper = _place(M, start + _LONG, y)
            to, bent = (y * wide + start) * channels, deeper / depth - 1
            if (_steady(pixels, shape, made, to, place_of, channels, _LONG, x0, y0, x1, y1, bent)
                    or _crossing(pixels, shape, made, to, place_of, channels, _LONG, x0, y0, x1, y1, bent)):
                continue
            for part in range(0, _LONG, _SHORT):
                end = part + _SHORT
                a, b = _along(part / _LONG, bent), _along(end / _LONG, bent)
                if not _crossing(pixels, shape, made, to + part * channels, place_of, channels, _SHORT,
                                 x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0),
                                 bent * _SHORT / _LONG):
                    _one_by_one(image, M, out, channels, start + part, start + end, y)


@inlined(fastmath=True)
def _place(M: Homography, x: float, y: float) -> Any:
    """Where in the picture a pixel of the result lies, and its depth."""
    depth = M[2, 0] * x + M[2, 1] * y + M[2, 2]
    inverse = 1 / depth
    return (M[0, 0] * x + M[0, 1] * y + M[0, 2]) * inverse, (M[1, 0] * x + M[1, 1] * y + M[1, 2]) * inverse, depth


@inlined(fastmath=True)
def _along(s: float, bent: float) -> Any:
    """How far from one end of a block to the other, in the picture, what is a share `s` of the way in the result.

    s (1 + bent) / (1 + s bent), to second order.
    """
    return s + bent * s * (1 - s)


@inlined(fastmath=True)
def _course(length: int, x0: float, y0: float, x1: float, y1: float, bent: float) -> Any:
    """How the place in the picture runs along a block: steps and bends in x and y, the column and row it begins in.

    The last one: how often it then crosses a row, or a column that moves along.
    """
    x_step, y_step = (x1 - x0) / length, (y1 - y0) / length
    x_bend, y_bend = bent * x_step / length, bent * y_step / length
    x_sag, y_sag = abs(x_bend) * length**2 / 4, abs(y_bend) * length**2 / 4
    column, row = np.floor(min(x0, x1 - length) - x_sag), np.floor(min(y0, y1) - y_sag)
    crossed = max(np.floor(max(x0, x1 - length) + x_sag) - column, np.floor(max(y0, y1) + y_sag) - row)
    return x_step, y_step, x_bend, y_bend, int(column), int(row), int(crossed)


@inlined(fastmath=True)
def _holds(shape: tuple[int, int], channels: int, column: int, row: int, columns: int, rows: int) -> bool:
    """Whether the picture has so many columns and rows from there on."""
    return column >= 0 and row >= 0 and (column + columns) * channels <= shape[1] and row + rows <= shape[0]


# Indices of values are unsigned: numba would ask of each signed one whether it counts from the end.
@inlined(fastmath=True)
def _steady(pixels: Image, shape: tuple[int, int], made: Image, to: int, place_of: FloatArray, channels: int,
            length: int, x0: float, y0: float, x1: float, y1: float, bent: float) -> bool:
    """A block whose pixels each lie between the same two rows, and as far along; False where that is not so.

    x0, y0, x1, y1: where its first pixel lies, and the one after its last. bent: see `_along`.
    """
    x_step, y_step, x_bend, y_bend, column, row, crossed = _course(length, x0, y0, x1, y1, bent)
    if crossed > 0 or not _holds(shape, channels, column, row, length + 1, 2):
        return False
    at, into = np.uint64(row * shape[1] + column * channels), np.uint64(to)
    right, down, whole = np.uint64(channels), np.uint64(shape[1]), np.float32(length)
    fx0, fx_step, fx_bend = np.float32(x0 - column), np.float32(x_step - 1), np.float32(x_bend)
    fy0, fy_step, fy_bend = np.float32(y0 - row), np.float32(y_step), np.float32(y_bend)
    for k in range(np.uint64(length * channels)):
        p = place_of[k]
        curve = p * (whole - p)
        fx, fy = fx0 + fx_step * p + fx_bend * curve, fy0 + fy_step * p + fy_bend * curve
        a, b = np.float32(pixels[at + k]), np.float32(pixels[at + k + right])
        c, d = np.float32(pixels[at + down + k]), np.float32(pixels[at + down + k + right])
        upper, lower = a + fx * (b - a), c + fx * (d - c)
        made[into + k] = np.int32(upper + fy * (lower - upper) + np.float32(0.5))
    return True


@inlined(fastmath=True)
def _crossing(pixels: Image, shape: tuple[int, int], made: Image, to: int, place_of: FloatArray,
              channels: int, length: int, x0: float, y0: float, x1: float, y1: float, bent: float) -> bool:
    """The same where a row, or a column, may be crossed once: of three, with those weights that are not 0."""
    x_step, y_step, x_bend, y_bend, column, row, crossed = _course(length, x0, y0, x1, y1, bent)
    if crossed > 1 or not _holds(shape, channels, column, row, length + 2, 3):
        return False
    at, into = np.uint64(row * shape[1] + column * channels), np.uint64(to)
    right, down, whole = np.uint64(channels), np.uint64(shape[1]), np.float32(length)
    fx0, fx_step, fx_bend = np.float32(x0 - column), np.float32(x_step - 1), np.float32(x_bend)
    fy0, fy_step, fy_bend = np.float32(y0 - row), np.float32(y_step), np.float32(y_bend)
    zero, one = np.float32(0), np.float32(1)
    for k in range(np.uint64(length * channels)):
        p = place_of[k]
        curve = p * (whole - p)
        fx, fy = fx0 + fx_step * p + fx_bend * curve, fy0 + fy_step * p + fy_bend * curve
        beyond_x, beyond_y = max(fx - one, zero), max(fy - one, zero)
        fx, fy = min(fx, one), min(fy, one)
        upper = _between(pixels, at + k, right, fx, beyond_x)
        middle = _between(pixels, at + down + k, right, fx, beyond_x)
        lower = _between(pixels, at + down + down + k, right, fx, beyond_x)
        made[into + k] = np.int32(upper + fy * (middle - upper) + beyond_y * (lower - middle) + np.float32(0.5))
    return True


@inlined(fastmath=True)
def _between(pixels: Image, at: int, right: int, fx: float, beyond: float) -> Any:
    """The value `fx` px along the way from one pixel to the next, and then `beyond` along that to the next but one."""
    a, b, c = np.float32(pixels[at]), np.float32(pixels[at + right]), np.float32(pixels[at + right + right])
    return a + fx * (b - a) + beyond * (c - b)


@inlined(fastmath=True)
def _one_by_one(image: Image, M: Homography, out: Image, channels: int, start: int, end: int,
                y: int) -> None:
    """Pixels at the border of the picture and beyond, where there is nothing but 0."""
    height, width = image.shape[0], image.shape[1] // channels
    for x in range(start, end):
        x_px, y_px, _depth = _place(M, x, y)
        column, row = int(np.floor(x_px)), int(np.floor(y_px))
        fx, fy = x_px - column, y_px - row
        for channel in range(channels):
            value = 0.0
            if -1 <= column < width and -1 <= row < height:
                for below in range(2):
                    for beside in range(2):
                        if 0 <= row + below < height and 0 <= column + beside < width:
                            weight = (fy if below else 1 - fy) * (fx if beside else 1 - fx)
                            value += weight * image[row + below, (column + beside) * channels + channel]
            out[y, x * channels + channel] = np.int32(value + 0.5)
