"""Sums of the products of two pictures, shifted by up to a pixel to each other, over the blocks of a grid."""

from __future__ import annotations

import numpy as np

from stab_ros.core.kernels import F32, I64, filled, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray

_MIN_ROWS_PER_THREAD = 4  # of blocks


def block_correlations(first: FloatArray, second: FloatArray, block_px: int) -> FloatArray:
    """Mean products (rows, columns, 3, 3) float32 of the pictures at lags of -1, 0 and 1 px, in y and x.

    A product counts halfway between its two pixels: half where the one is, half where the other is. So two equal
    pictures have a symmetric correlation in any block, whatever passes its border.

    Args:
        first: (h, w) float32.
        second: (h, w) float32.
        block_px: side of the blocks.
    """
    rows, columns = (n // block_px for n in first.shape)
    out = np.zeros((rows, columns, 3, 3), np.float32)
    framed = [np.ascontiguousarray(np.pad(picture, 1, mode="edge"), np.float32) for picture in (first, second)]

    def part(start: int, end: int) -> None:
        _sum(framed[0], framed[1], block_px, out, start, end)

    in_parallel(part, rows, _MIN_ROWS_PER_THREAD)
    return out


@kernel((read(F32, 2), read(F32, 2), I64, filled(F32, 4), I64, I64), fastmath=True)
def _sum(first: FloatArray, second: FloatArray, block_px: int, out: FloatArray, start: int, end: int) -> None:
    """Fills rows `start` to `end` of the blocks; the pictures have a border of one pixel."""
    share = np.float32(0.5 / block_px**2)
    for row in range(start, end):
        for column in range(out.shape[1]):
            top, left = 1 + row * block_px, 1 + column * block_px
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    total = np.float32(0)
                    for y in range(top, top + block_px):
                        for x in range(left, left + block_px):
                            total += first[y, x] * second[y + dy, x + dx] + first[y - dy, x - dx] * second[y, x]
                    out[row, column, dy + 1, dx + 1] = share * total
