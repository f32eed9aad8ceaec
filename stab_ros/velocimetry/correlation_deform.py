"""Pictures drawn along a field of displacements, for correlation: window deformation of particle image velocimetry.

Scarano (2002): both pictures of a pair are drawn half of the displacement back or forth, so that they show the same
also where the water shears. Interpolation is by cubic B-splines (Unser, Aldroubi and Eden 1991): cubic convolution
moves fine texture too little, by a sixteenth of the way, and OpenCV's tables have steps of 1/32 px; both are errors of
the same sign all over a window.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.kernels import F32, F64, I64, filled, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray

_MIN_ROWS_PER_THREAD = 64
_POLE = np.sqrt(3) - 2
_TO_SPLINE = -6 * _POLE / (1 - _POLE**2) * _POLE ** np.abs(np.arange(-8, 9))  # what is cut off is below 1e-4


def deformed(picture: FloatArray, shift_px: FloatArray, first_px: float, step_px: float) -> FloatArray:
    """The picture at places moved by a field: result(x) = picture(x + shift(x)).

    Args:
        picture: (h, w) float32.
        shift_px: (rows, columns, 2), x and y of the field at its nodes, linear between them and constant beyond.
        first_px: x and y of the first node.
        step_px: distance of the nodes.

    Returns:
        (h, w) float32; the values of the border beyond it.
    """
    source = np.asarray(cv2.sepFilter2D(picture, cv2.CV_32F, _TO_SPLINE, _TO_SPLINE, borderType=cv2.BORDER_REFLECT_101))
    out = np.empty(picture.shape, np.float32)
    along_x, along_y = (np.ascontiguousarray(shift_px[:, :, k], np.float64) for k in (0, 1))

    def part(first: int, last: int) -> None:
        _deform(source, along_x, along_y, first_px, step_px, out, first, last)

    in_parallel(part, len(out), _MIN_ROWS_PER_THREAD)
    return out


@kernel((read(F32, 2), read(F64, 2), read(F64, 2), F64, F64, filled(F32, 2), I64, I64), fastmath=True)
def _deform(picture: FloatArray, along_x: FloatArray, along_y: FloatArray, first_px: float, step_px: float,
            out: FloatArray, first: int, last: int) -> None:
    """Fills rows `first` to `last`."""
    height, width = picture.shape
    rows, columns = along_x.shape
    for y in range(first, last):
        at = min(max((y - first_px) / step_px, 0.0), rows - 1.0)
        row = min(int(at), max(rows - 2, 0))
        below, next_row = at - row, min(row + 1, rows - 1)
        for x in range(width):
            at = min(max((x - first_px) / step_px, 0.0), columns - 1.0)
            column = min(int(at), max(columns - 2, 0))
            right, beside = at - column, min(column + 1, columns - 1)
            a, b = (1 - below) * (1 - right), (1 - below) * right
            c, d = below * (1 - right), below * right
            px = x + (a * along_x[row, column] + b * along_x[row, beside]
                      + c * along_x[next_row, column] + d * along_x[next_row, beside])
            py = y + (a * along_y[row, column] + b * along_y[row, beside]
                      + c * along_y[next_row, column] + d * along_y[next_row, beside])
            px, py = min(max(px, 1.0), width - 3.0), min(max(py, 1.0), height - 3.0)
            left, top = int(px), int(py)
            s, t = np.float32(px - left), np.float32(py - top)
            x0, x1 = (1 - s) ** 3, (np.float32(3) * s - np.float32(6)) * s * s + np.float32(4)
            x2, x3 = ((np.float32(3) - np.float32(3) * s) * s + np.float32(3)) * s + np.float32(1), s**3
            y0, y1 = (1 - t) ** 3, (np.float32(3) * t - np.float32(6)) * t * t + np.float32(4)
            y2, y3 = ((np.float32(3) - np.float32(3) * t) * t + np.float32(3)) * t + np.float32(1), t**3
            value = np.float32(0)
            for k in range(4):
                weight = y0 if k == 0 else (y1 if k == 1 else (y2 if k == 2 else y3))
                line = top - 1 + k
                value += weight * (x0 * picture[line, left - 1] + x1 * picture[line, left]
                                   + x2 * picture[line, left + 1] + x3 * picture[line, left + 2])
            out[y, x] = value / np.float32(36)
