"""Correlations of two pictures that are drawn along a field of displacements, summed over the blocks of a grid.

Window deformation of particle image velocimetry (Scarano 2002): both pictures of a pair are drawn half of the
displacement back or forth, so that they show the same also where the water shears. Interpolation is by cubic B-splines
(Unser, Aldroubi and Eden 1991): cubic convolution moves fine texture too little, by a sixteenth of the way, and
OpenCV's tables have steps of 1/32 px; both are errors of the same sign all over a window. What is left are lags of one
pixel. Only the blocks that are wanted are drawn, a row of blocks at a time, which stays in the processor's cache.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from stab_ros.core.kernels import BOOL, F32, I16, I64, filled, inlined, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import BoolArray, FloatArray, IdArray

_MIN_ROWS_PER_THREAD = 4  # of blocks
_POLE = np.sqrt(3) - 2
_TO_SPLINE = -6 * _POLE / (1 - _POLE**2) * _POLE ** np.abs(np.arange(-8, 9))  # what is cut off is below 1e-4
_UNITS = 1024  # of a spline's coefficients, to one of the picture


def as_spline(picture: FloatArray) -> IdArray:
    """Coefficients (h, w) int16 of the cubic B-spline through a picture (h, w) float32 of values about 1."""
    fine = cv2.sepFilter2D(picture, cv2.CV_32F, _TO_SPLINE, _TO_SPLINE, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(cv2.multiply(fine, float(_UNITS), dtype=cv2.CV_16S))


def from_spline(spline: IdArray) -> FloatArray:
    """The picture (h, w) float32 of a spline."""
    weights = np.array([1.0, 4.0, 1.0]) / 6
    picture = cv2.sepFilter2D(spline, cv2.CV_32F, weights / _UNITS, weights, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(picture)


def block_correlations(first: IdArray, second: IdArray, shift_px: FloatArray, first_px: float, step_px: float,
                       block_px: int, wanted: BoolArray) -> FloatArray:
    """Mean products of two pictures at lags of -1, 0 and 1 px in y and x, (rows, columns, 10) float32.

    The last one is the mean of their powers: no lag has a larger sum of products over a region.

    The pictures are drawn along the field: `first` at x - shift(x) / 2, `second` at x + shift(x) / 2. A product counts
    halfway between its two pixels: half where the one is, half where the other is. So two equal pictures have a
    symmetric correlation in any block, whatever passes its border.

    Args:
        first: (h, w) int16, of `as_spline`.
        second: (h, w) int16.
        shift_px: (r, c, 2), x and y of the field at its nodes, linear between them and constant beyond.
        first_px: x and y of the first node.
        step_px: distance of the nodes.
        block_px: side of the blocks.
        wanted: (rows, columns) of blocks; the others are 0.
    """
    rows, columns = (n // block_px for n in first.shape)
    out = np.zeros((rows, columns, 10), np.float32)
    along_x, along_y = (np.ascontiguousarray(shift_px[:, :, k], np.float32) for k in (0, 1))

    def part(start: int, end: int) -> None:
        _correlate(first, second, along_x, along_y, first_px, step_px, block_px, wanted, out, start, end)

    in_parallel(part, rows, _MIN_ROWS_PER_THREAD)
    return out


# The helpers are inlined, so that fresh and cached code round alike (see `methods.patches`).
@kernel((read(I16, 2), read(I16, 2), read(F32, 2), read(F32, 2), F32, F32, I64, read(BOOL, 2), filled(F32, 3), I64,
         I64), fastmath=True)
def _correlate(first: IdArray, second: IdArray, along_x: FloatArray, along_y: FloatArray, first_px: Any,
               step_px: Any, block_px: int, wanted: BoolArray, out: FloatArray, start: int, end: int) -> None:
    """Fills rows `start` to `end` of the blocks; of each, what lies between the first and the last wanted one."""
    columns, width = out.shape[1], out.shape[1] * block_px + 2  # with a border of a pixel
    one, two = np.empty((block_px + 2, width), np.float32), np.empty((block_px + 2, width), np.float32)
    sums, moved = np.empty((10, width), np.float32), np.empty((9, width), np.float32)
    per_px = np.float32(1) / step_px
    nodes, along = np.empty((2, along_x.shape[1] + 1), np.float32), np.empty(width, np.float32)
    shift, across = np.empty(width, np.float32), np.empty(first.shape[1], np.float32)
    drawn = np.empty(first.shape[1], np.float32)
    for row in range(start, end):
        begin, stop = columns, 0
        for column in range(columns):
            if wanted[row, column]:
                begin, stop = min(begin, column), column + 1
        if stop == 0:
            continue
        left, right = begin * block_px, stop * block_px + 2
        for k in range(block_px + 2):
            y = row * block_px + k - 1
            _field(along_x, along_y, (np.float32(y) - first_px) * per_px, nodes)
            _shifts_along(nodes[0], first_px, per_px, left, along[left:right])
            for half, spline, line in ((np.float32(-0.5), first, one[k]), (np.float32(0.5), second, two[k])):
                low, high = _shifts(nodes[1], along, half, first_px, per_px, left, right, shift, across)
                _draw_across(spline, across, y, low, high, drawn)
                _draw_along(drawn, shift, left, right, line)
        _sum_rows(one, two, block_px, left, right, sums, moved)
        for column in range(begin, stop):
            if wanted[row, column]:
                _sum_block(sums, moved, block_px, 1 + column * block_px, out[row, column])


@inlined(fastmath=True)
def _field(along_x: FloatArray, along_y: FloatArray, at: Any, nodes: FloatArray) -> None:
    """Fills the field (2, columns + 1) on a row of pixels, which lies `at` rows of nodes below the first one."""
    rows, columns = along_x.shape
    inside = min(max(at, np.float32(0)), np.float32(rows - 1))
    upper = min(int(inside), max(rows - 2, 0))
    lower, share = min(upper + 1, rows - 1), inside - np.float32(upper)
    for j in range(columns):
        nodes[0, j] = along_x[upper, j] + share * (along_x[lower, j] - along_x[upper, j])
        nodes[1, j] = along_y[upper, j] + share * (along_y[lower, j] - along_y[upper, j])
    nodes[:, columns] = nodes[:, columns - 1]


@inlined(fastmath=True)
def _between(nodes: FloatArray, at: Any) -> Any:
    """The value `at` nodes from the first one; constant beyond."""
    inside = min(max(at, np.float32(0)), np.float32(len(nodes) - 2))
    node = np.int32(inside)
    value = nodes[np.uint32(node)]
    return value + (inside - np.float32(node)) * (nodes[np.uint32(node + 1)] - value)


@inlined(fastmath=True)
def _shifts_along(nodes: FloatArray, first_px: Any, per_px: Any, left: int, along: FloatArray) -> None:
    """Fills the field along x of a row of pixels; element i is pixel left + i - 1."""
    for i in range(len(along)):
        along[i] = _between(nodes, (np.float32(left + i - 1) - first_px) * per_px)


@inlined(fastmath=True)
def _shifts(nodes: FloatArray, along: FloatArray, half: Any, first_px: Any, per_px: Any, left: int, right: int,
            shift: FloatArray, across: FloatArray) -> tuple[int, int]:
    """Fills the shifts along x of pixels i - 1 that are drawn, and those across of the columns that they come from.

    nodes: of the field across. along: the field along x. Returns the first of the columns, and the one after the last.
    """
    width = len(across)
    least, most = np.float32(width), np.float32(0)
    for i in range(left, right):
        x = np.float32(i - 1)
        to = min(max(x + half * along[i], np.float32(1)), np.float32(width - 3))
        shift[i] = to - x
        least, most = min(least, to), max(most, to)
    low, high = int(least) - 1, int(most) + 3
    for u in range(low, high):
        from_x = np.float32(u) - half * along[min(max(u + 1, left), right - 1)]
        across[u] = half * _between(nodes, (from_x - first_px) * per_px)
    return low, high


@inlined(fastmath=True)
def _draw_across(spline: IdArray, across: FloatArray, y: int, low: int, high: int, drawn: FloatArray) -> None:
    """Draws columns of a row of pixels, each moved across; runs of columns come from the same four rows."""
    height = spline.shape[0]
    begin = low
    while begin < high:
        whole = np.floor(across[begin])
        end = begin + 1
        while end < high and across[end] >= whole and across[end] < whole + np.float32(1):
            end += 1
        top = min(max(y + int(whole), 1), height - 3)
        a, b = spline[top - 1, begin:end], spline[top, begin:end]
        c, d = spline[top + 1, begin:end], spline[top + 2, begin:end]
        shift, out = across[begin:end], drawn[begin:end]
        for i in range(end - begin):  # from 0, which numba compiles to vector instructions
            t = shift[i] - whole
            t2, t3 = t * t, t * t * t
            wb = np.float32(3) * t3 - np.float32(6) * t2 + np.float32(4)
            wc = np.float32(1) + np.float32(3) * (t + t2 - t3)
            wa = np.float32(6) - wb - wc - t3
            out[i] = wa * np.float32(a[i]) + wb * np.float32(b[i]) + wc * np.float32(c[i]) + t3 * np.float32(d[i])
        begin = end


@inlined(fastmath=True)
def _draw_along(drawn: FloatArray, shift: FloatArray, left: int, right: int, line: FloatArray) -> None:
    """Draws a row of pixels i - 1, each moved along it."""
    scale = np.float32(1 / (36 * _UNITS))
    begin = left
    while begin < right:
        whole = np.floor(shift[begin])
        end = begin + 1
        while end < right and shift[end] >= whole and shift[end] < whole + np.float32(1):
            end += 1
        at, count = begin + int(whole) - 2, end - begin
        a, b, c, d = drawn[at : at + count], drawn[at + 1 :], drawn[at + 2 :], drawn[at + 3 :]
        moved, out = shift[begin:end], line[begin:end]
        for i in range(count):
            t = moved[i] - whole
            t2, t3 = t * t, t * t * t
            wb = np.float32(3) * t3 - np.float32(6) * t2 + np.float32(4)
            wc = np.float32(1) + np.float32(3) * (t + t2 - t3)
            wa = np.float32(6) - wb - wc - t3
            out[i] = scale * (wa * a[i] + wb * b[i] + wc * c[i] + t3 * d[i])
        begin = end


@inlined(fastmath=True)
def _sum_rows(one: FloatArray, two: FloatArray, block_px: int, left: int, right: int, sums: FloatArray,
              moved: FloatArray) -> None:
    """Fills the products of each lag, summed over the rows of a block: where `one` is (`sums`), and `two` (`moved`).

    And with the squares of both, the last row of `sums`.
    """
    sums[:, left:right] = np.float32(0)
    for y in range(1, block_px + 1):
        power, picture, other = sums[9, left:right], one[y, left:right], two[y, left:right]
        for x in range(right - left):
            power[x] += picture[x] * picture[x] + other[x] * other[x]
        for lag in range(9):
            _add_row(one, two, y, lag, left, right, np.float32(1), sums[lag])
    for lag in range(9):
        total, there = sums[lag, left:right], moved[lag, left:right]
        for x in range(right - left):
            there[x] = total[x]
        if lag // 3 != 1:
            more, less = (0, block_px) if lag // 3 == 2 else (block_px + 1, 1)
            _add_row(one, two, more, lag, left, right, np.float32(1), moved[lag])
            _add_row(one, two, less, lag, left, right, np.float32(-1), moved[lag])


@inlined(fastmath=True)
def _add_row(one: FloatArray, two: FloatArray, y: int, lag: int, left: int, right: int, sign: Any, sums: FloatArray
             ) -> None:
    """Adds the products of row y of `one` at a lag."""
    dy, dx = lag // 3 - 1, lag % 3 - 1
    begin, end = left + (dx < 0), right - (dx > 0)
    total, picture, other = sums[begin:end], one[y, begin:end], two[y + dy, begin + dx : end + dx]
    for x in range(end - begin):  # from 0, which numba compiles to vector instructions
        total[x] += sign * picture[x] * other[x]


@inlined(fastmath=True)
def _sum_block(sums: FloatArray, moved: FloatArray, block_px: int, left: int, out: FloatArray) -> None:
    """Fills the means (10,) of a block that begins at pixel `left`."""
    share = np.float32(0.5 / block_px**2)
    for dy in range(3):
        for dx in range(3):
            total = np.float32(0)
            for x in range(left, left + block_px):
                total += sums[3 * dy + dx, x] + moved[3 * dy + dx, x - dx + 1]
            out[3 * dy + dx] = share * total
    out[9] = share * np.sum(sums[9, left : left + block_px])
