"""A field of displacements on a regular grid of windows that is known in part: filled and freed of outliers.

As predictor of the next pass only; what is measured there is neither filtered nor smoothed.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d, distance_transform_edt, median_filter

from stab_ros.core.types import BoolArray, FloatArray

# integral of a field that is linear between nodes over a window, along one axis, by windows that begin within its side
_MEAN_WEIGHTS = {1: (1 / 8, 3 / 4, 1 / 8), 2: (1 / 4, 1 / 2, 1 / 4), 4: (1 / 8, 1 / 4, 1 / 4, 1 / 4, 1 / 8)}
_OUTLIER = 3.0  # of the normalized median test
_FLOOR_PX = 0.5  # of its scatter


def filled(shift_px: FloatArray, known: BoolArray) -> FloatArray:
    """(rows, columns, 2) without gaps: the nearest known value in each, and medians in place of outliers.

    The normalized median test is Westerweel and Scarano (2005).

    Args:
        shift_px: (rows, columns, 2).
        known: (rows, columns).
    """
    if not known.any():
        return np.zeros_like(shift_px)
    row, column = distance_transform_edt(~known, return_distances=False, return_indices=True)
    whole = shift_px[row, column]
    middle = median_filter(whole, size=(3, 3, 1), mode="nearest")
    scatter = median_filter(np.abs(whole - middle), size=(3, 3, 1), mode="nearest")
    wrong = (np.abs(whole - middle) > _OUTLIER * (scatter + _FLOOR_PX)).any(axis=2)
    return np.asarray(np.where(wrong[:, :, None], middle, whole))


def widened(shift_px: FloatArray) -> FloatArray:
    """The field (rows, columns, 2) with another node on each side, which continues it linearly."""
    sides = [(0, 0) if n < 2 else (1, 1) for n in shift_px.shape[:2]]
    straight = np.pad(shift_px, [*sides, (0, 0)], mode="reflect", reflect_type="odd")
    return np.pad(straight, [(1 - k, 1 - k) for k, _ in sides] + [(0, 0)], mode="edge")


def window_mean(field_px: FloatArray, per_side: int) -> FloatArray:
    """Means (rows, columns, 2) over the windows of a field that is linear between its nodes.

    What is measured in a deformed window adds to this, not to the value in its middle: else noise of the field stays.

    Args:
        field_px: (rows + 2, columns + 2, 2), with another node on each side.
        per_side: number of windows that begin within the side of one: 1, 2 or 4.
    """
    weights = np.array(_MEAN_WEIGHTS[per_side])
    along = correlate1d(correlate1d(field_px, weights, axis=0, mode="nearest"), weights, axis=1, mode="nearest")
    return np.asarray(along[1:-1, 1:-1])
