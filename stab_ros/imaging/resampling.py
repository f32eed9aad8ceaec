"""Bilinear resampling by a map near the identity, as for a hovering camera: a homography, or one through a lens.

For such a map, long runs of a row of the result are read from a single row of the source. Blocks of a row are
interpolated with contiguous loads and linearly increasing fractions, which compilers vectorize. OpenCV instead gathers
four neighbours for every pixel. Source positions are exact at both ends of a block and quadratic in between.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stab_ros.core.kernels import F32, F64, I64, U8, U16, filled, inlined, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray, Homography, Image

_LONG, _SHORT = 64, 16  # block lengths, px; short ones where long ones are not applicable
_MAX_SLOPE = 0.65 / _SHORT  # largest deviation of the Jacobian from the identity; above, OpenCV is faster
_MAX_DEPTH_CHANGE = 0.01  # relative, along a block; position errors grow with its square, to 0.002 px
_MIN_ROWS_PER_THREAD = 64
NODE_PX = _LONG // 2  # columns from one node of `Nodes` to the next
_TOLERANCE_PX = 0.004  # of the quadratic between nodes
_NODE_SLOPE, _MOSTLY = 0.9 / _SHORT, 0.75  # as _MAX_SLOPE, for that share of the steps between nodes


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


@dataclass(frozen=True, eq=False)
class Nodes:
    """Source positions of every 32nd pixel of rows of a result, from its first one on.

    x_px, y_px: (rows, n) float32, n such that they reach beyond the last block of 64 pixels.
    """

    x_px: FloatArray
    y_px: FloatArray

    @staticmethod
    def columns(wide: int) -> int:
        """N for results of this width."""
        return 2 * (-(-wide // _LONG)) + 1

    @property
    def gentle(self) -> bool:
        """Whether `resample_at` is exact to 0.01 px, and faster than OpenCV."""
        steps = np.stack([np.diff(places) for places in (self.x_px, self.y_px)]) / NODE_PX
        third = np.diff(steps, n=2) * NODE_PX
        slopes = np.abs(steps - np.array([1.0, 0.0])[:, None, None]).max(axis=0)
        exact = np.abs(third).max(initial=0) < 16 * _TOLERANCE_PX  # a cubic leaves its quadratic by a 16th
        return bool(exact and np.mean(slopes < _NODE_SLOPE) >= _MOSTLY)


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


def resample_at(image: Image, nodes: Nodes, out: Image) -> None:
    """Fills `out` with `image` at the positions that lie quadratically between nodes. Else as `resample`.

    Args:
        image: (h, w) or (h, w, channels), uint8 or uint16, C-contiguous.
        nodes: `gentle` must hold.
        out: the same number of channels and dtype, C-contiguous.
    """
    channels = 1 if image.ndim == 2 else image.shape[2]
    pixels, result = image.reshape(len(image), -1), out.reshape(len(out), -1)
    pixel_of = np.repeat(np.arange(_LONG, dtype=np.float32), channels)

    def rows(first: int, last: int) -> None:
        _resample_at(pixels, nodes.x_px, nodes.y_px, result, pixel_of, channels, first, last)

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
            x_bend, y_bend = _bend(x0, x1, depth_change, _LONG), _bend(y0, y1, depth_change, _LONG)
            if (_within_rows(pixels, shape, result, to, pixel_of, channels, _LONG, x0, y0, x1, y1, x_bend, y_bend) or
                    _across_rows(pixels, shape, result, to, pixel_of, channels, _LONG, x0, y0, x1, y1, x_bend, y_bend)):
                continue
            for part in range(0, _LONG, _SHORT):
                end = part + _SHORT
                a, b = _source_share(part / _LONG, depth_change), _source_share(end / _LONG, depth_change)
                xa, ya, xb, yb = x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0)
                change = depth_change * _SHORT / _LONG
                if not _across_rows(pixels, shape, result, to + part * channels, pixel_of, channels, _SHORT, xa, ya, xb,
                                    yb, _bend(xa, xb, change, _SHORT), _bend(ya, yb, change, _SHORT)):
                    _pixel_by_pixel(image, M, out, channels, start + part, start + end, y)


@kernel(*((read(value, 2), read(F32, 2), read(F32, 2), filled(value, 2), read(F32, 1), I64, I64, I64)
          for value in (U8, U16)), fastmath=True)
def _resample_at(image: Image, x_px: FloatArray, y_px: FloatArray, out: Image, pixel_of: FloatArray, channels: int,
                 first: int, last: int) -> None:
    """As `_resample`, at the positions between nodes."""
    shape = image.shape
    wide, pixels, result = out.shape[1] // channels, image.ravel(), out.ravel()
    for y in range(first, last):
        for start in range(0, wide, _LONG):
            node, to = start // NODE_PX, (y * wide + start) * channels
            x0, x1, y0, y1 = x_px[y, node], x_px[y, node + 2], y_px[y, node], y_px[y, node + 2]
            x_bend = (2 * x_px[y, node + 1] - x0 - x1) * 2 / _LONG**2
            y_bend = (2 * y_px[y, node + 1] - y0 - y1) * 2 / _LONG**2
            if start + _LONG <= wide and (
                    _within_rows(pixels, shape, result, to, pixel_of, channels, _LONG, x0, y0, x1, y1, x_bend, y_bend)
                    or _across_rows(pixels, shape, result, to, pixel_of, channels, _LONG, x0, y0, x1, y1, x_bend,
                                    y_bend)):
                continue
            x_step, y_step = (x1 - x0) / _LONG, (y1 - y0) / _LONG
            for part in range(0, min(_LONG, wide - start), _SHORT):
                end = part + _SHORT
                xa, ya = _on_path(x0, x_step, x_bend, part), _on_path(y0, y_step, y_bend, part)
                xb, yb = _on_path(x0, x_step, x_bend, end), _on_path(y0, y_step, y_bend, end)
                if start + end <= wide and _across_rows(pixels, shape, result, to + part * channels, pixel_of, channels,
                                                        _SHORT, xa, ya, xb, yb, x_bend, y_bend):
                    continue
                for k in range(part, min(end, wide - start)):
                    _interpolate_pixel(image, out, channels, start + k, y, _on_path(x0, x_step, x_bend, k),
                                       _on_path(y0, y_step, y_bend, k))


@inlined(fastmath=True)
def _on_path(start: float, step: float, bend: float, place: int) -> float:
    """A coordinate of a path of `_LONG` pixels, after some of them."""
    return start + step * place + bend * place * (_LONG - place)


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
def _bend(start: float, end: float, depth_change: float, length: int) -> float:
    """Second-order term of a source path: its place after k pixels is start + k step + k (length - k) bend."""
    return depth_change * ((end - start) / length) / length


@inlined(fastmath=True)
def _block_path(length: int, x0: float, y0: float, x1: float, y1: float, x_bend: float, y_bend: float) -> Any:
    """Source path of a block: steps in x and y, first column and row, number of crossings.

    A crossing is a change of the source row, or of the column relative to the pixel's position in the block.
    """
    x_step, y_step = (x1 - x0) / length, (y1 - y0) / length
    x_sag, y_sag = abs(x_bend) * length**2 / 4, abs(y_bend) * length**2 / 4
    column, row = np.floor(min(x0, x1 - length) - x_sag), np.floor(min(y0, y1) - y_sag)
    crossed = max(np.floor(max(x0, x1 - length) + x_sag) - column, np.floor(max(y0, y1) + y_sag) - row)
    return x_step, y_step, int(column), int(row), int(crossed)


@inlined(fastmath=True)
def _contains(shape: tuple[int, int], channels: int, column: int, row: int, columns: int, rows: int) -> bool:
    """Whether the image contains `columns` x `rows` pixels from (column, row) on."""
    return column >= 0 and row >= 0 and (column + columns) * channels <= shape[1] and row + rows <= shape[0]


# Indices are unsigned, because numba checks each signed one for wraparound.
@inlined(fastmath=True)
def _within_rows(pixels: Image, shape: tuple[int, int], result: Image, to: int, pixel_of: FloatArray, channels: int,
            length: int, x0: float, y0: float, x1: float, y1: float, x_bend: float, y_bend: float) -> bool:
    """Fills a block whose source path crosses no row or column; False if it does.

    x0, y0: source position of its first pixel. x1, y1: of the pixel after its last. x_bend, y_bend: see `_bend`.
    """
    x_step, y_step, column, row, crossed = _block_path(length, x0, y0, x1, y1, x_bend, y_bend)
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
              channels: int, length: int, x0: float, y0: float, x1: float, y1: float, x_bend: float,
              y_bend: float) -> bool:
    """As `_within_rows`, for a path with at most one crossing: interpolates in three rows and columns."""
    x_step, y_step, column, row, crossed = _block_path(length, x0, y0, x1, y1, x_bend, y_bend)
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
    """Fills pixels near and outside the border of the image."""
    for x in range(start, end):
        x_px, y_px, _depth = _source_position(M, x, y)
        _interpolate_pixel(image, out, channels, x, y, x_px, y_px)


@inlined(fastmath=True)
def _interpolate_pixel(image: Image, out: Image, channels: int, x: int, y: int, x_px: float, y_px: float) -> None:
    """Fills one pixel; the image is 0 beyond its border."""
    height, width = image.shape[0], image.shape[1] // channels
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
