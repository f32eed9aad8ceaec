"""Where the pixels of a warped image come from if the rows of the frame were shifted by a rolling shutter."""

from __future__ import annotations

import numpy as np

from stab_ros.core.kernels import F32, F64, I64, filled, kernel, read
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray, Homography
from stab_ros.imaging.lens_maps import RemapTables

_STEP_PX = 0.25  # of the table of displacements, linear between: below 0.001 px
_OUTSIDE_PX = np.float32(-1e6)
_MIN_ROWS_PER_THREAD = 64


def row_maps(ref_H_cur: Homography, rows: RowShifts, size: tuple[int, int], then: Homography) -> RemapTables:
    """Positions (h, w) in the frame, for `cv2.remap`, of the pixels of an image of `size` (width, height).

    The inverse homography gives where a pixel belongs in the frame. The row that shows it follows from the row alone,
    so the inverse of the displacements is tabulated.

    Args:
        ref_H_cur: (3, 3), from the frame to the image.
        rows: displacements of the frame's rows.
        size: of the image, px.
        then: (3, 3), applied to the positions.
    """
    x_px, y_px = np.empty((size[1], size[0]), np.float32), np.empty((size[1], size[0]), np.float32)
    belongs_px = np.arange(-rows.most_px - 1, rows.height + rows.most_px + 1, _STEP_PX)
    points = np.stack([np.zeros_like(belongs_px), belongs_px], axis=1)
    shift_px, cur_M_ref = points - rows.before(points), np.linalg.inv(ref_H_cur)

    def part(first: int, last: int) -> None:
        _fill(cur_M_ref, shift_px, float(belongs_px[0]), then, x_px, y_px, first, last)

    in_parallel(part, size[1], _MIN_ROWS_PER_THREAD)
    return x_px, y_px


@kernel((read(F64, 2), read(F64, 2), F64, read(F64, 2), filled(F32, 2), filled(F32, 2), I64, I64))
def _fill(M: Homography, shift_px: FloatArray, start_px: float, then: Homography, x_px: FloatArray, y_px: FloatArray,
          first: int, last: int) -> None:
    """Fills rows `first` to `last` of the maps. shift_px: (n, 2) displacements of places from row start_px on."""
    for row in range(first, last):
        for column in range(x_px.shape[1]):
            depth = M[2, 0] * column + M[2, 1] * row + M[2, 2]
            x = (M[0, 0] * column + M[0, 1] * row + M[0, 2]) / depth
            y = (M[1, 0] * column + M[1, 1] * row + M[1, 2]) / depth
            at = min(max((y - start_px) / _STEP_PX, 0.0), len(shift_px) - 1.001)
            entry = int(at)
            part = at - entry
            x -= shift_px[entry, 0] + part * (shift_px[entry + 1, 0] - shift_px[entry, 0])
            y -= shift_px[entry, 1] + part * (shift_px[entry + 1, 1] - shift_px[entry, 1])
            w = then[2, 0] * x + then[2, 1] * y + then[2, 2]
            seen = depth > 0 and w > 0
            x_px[row, column] = (then[0, 0] * x + then[0, 1] * y + then[0, 2]) / w if seen else _OUTSIDE_PX
            y_px[row, column] = (then[1, 0] * x + then[1, 1] * y + then[1, 2]) / w if seen else _OUTSIDE_PX
