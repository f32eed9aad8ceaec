"""Where windows of the reference lie in a speckled frame, to a fraction of a pixel: by correlation.

Key points under speckle are placed to a pixel at best. A window about each holds a thousand pixels, and correlating
the logarithms of local means (there speckle adds, and hardly depends on brightness) places it to a fraction of one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.methods._roewa import Floats

_BLUR_PX = 1.5
_SEARCH_PX = 4
# Pixels that are as good as one independent one, after the blur: measured against the truth of synthetic flights, the
# same for windows of 25 to 65 px and blurs of 1.5 to 3 px.
_CORRELATED_PX = 4.4 * np.pi * _BLUR_PX**2


@dataclass(frozen=True, eq=False)
class Peaks:
    """Of N windows: displacement (N, 2) px, its information (N, 2, 2), the correlation there (N,), whether any (N,)."""

    displacement: FloatArray
    information: FloatArray
    correlation: FloatArray
    found: BoolArray


def logarithm(gray: Gray) -> Floats:
    """The logarithm of the local mean, (h, w) float32."""
    mean = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), _BLUR_PX)
    return np.asarray(np.log(mean + 1))


def correlated(reference: Floats, current: Floats, pairs: Correspondences, H: Homography, radius: int,
               least: float) -> Correspondences:
    """The pairs whose windows of the reference are found again next to where H (ref_H_cur) puts them, placed anew.

    reference, current: `logarithm` of the pictures. radius: half a window, px. least: correlation.
    """
    warped = cv2.warpPerspective(current, H, reference.shape[::-1], flags=cv2.INTER_LINEAR,
                                 borderMode=cv2.BORDER_REPLICATE)
    corner = np.round(pairs.reference_px).astype(np.int64)
    whole = _whole(corner, H, radius + _SEARCH_PX, reference.shape)
    peaks = _peaks(reference, warped, corner[whole], radius)
    good = peaks.found & (peaks.correlation >= least)
    kept = np.flatnonzero(whole)[good]
    reference_px = pairs.reference_px[kept]
    current_px = apply(np.linalg.inv(H), reference_px + peaks.displacement[good])
    return Correspondences(pairs.feature_id[kept], reference_px, current_px, peaks.information[good])


def _whole(corner: IdArray, H: Homography, reach: int, shape: tuple[int, ...]) -> BoolArray:
    """Which windows (n,) with their search areas lie inside both pictures."""
    cur_H_ref, size = np.linalg.inv(H), (shape[1], shape[0])
    ends = [corner + np.array([x, y]) for x in (-reach, reach) for y in (-reach, reach)]
    both = [inside(end, size) & inside(apply(cur_H_ref, end.astype(float)), size) for end in ends]
    return np.asarray(np.all(both, axis=0))


def _peaks(reference: Floats, warped: Floats, corner: IdArray, radius: int) -> Peaks:
    n, samples = len(corner), (2 * radius + 1) ** 2 / _CORRELATED_PX
    peaks = Peaks(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n), np.zeros(n, bool))
    for k, (x, y) in enumerate(corner.tolist()):
        scores = _scores(reference, warped, x, y, radius)
        row, column = np.unravel_index(scores.argmax(), scores.shape)
        if 0 < row < 2 * _SEARCH_PX and 0 < column < 2 * _SEARCH_PX:
            about = scores[row - 1 : row + 2, column - 1 : column + 2].astype(np.float64)
            bend, offset = _paraboloid(about)
            peaks.found[k] = np.linalg.eigvalsh(bend)[0] > 0 and np.abs(offset).max() < 1
            peaks.displacement[k] = np.array([column, row]) - _SEARCH_PX + offset
            peaks.correlation[k] = about[1, 1]
            peaks.information[k] = samples * bend / max(1 - about[1, 1] ** 2, 1e-6)
    return peaks


def _scores(reference: Floats, warped: Floats, x: int, y: int, radius: int) -> Floats:
    """Normalised correlation for each shift of the warped picture's window, y before x.

    Window and area change roles and the mean of both counts: one way alone, a window does not even fit itself best.
    """
    near, far = (np.s_[y - reach : y + reach + 1, x - reach : x + reach + 1]
                 for reach in (radius, radius + _SEARCH_PX))
    there = cv2.matchTemplate(warped[far], reference[near], cv2.TM_CCOEFF_NORMED)
    back = cv2.matchTemplate(reference[far], warped[near], cv2.TM_CCOEFF_NORMED)
    return np.asarray((there + back[::-1, ::-1]) / 2)


def _paraboloid(about: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Negative second derivatives (2, 2) of 3x3 scores and the peak's place (2,) from the middle, x before y."""
    xx = 2 * about[1, 1] - about[1, 0] - about[1, 2]
    yy = 2 * about[1, 1] - about[0, 1] - about[2, 1]
    xy = (about[0, 2] + about[2, 0] - about[0, 0] - about[2, 2]) / 4
    bend = np.array([[xx, xy], [xy, yy]])
    slope = np.array([about[1, 2] - about[1, 0], about[2, 1] - about[0, 1]]) / 2
    return bend, np.linalg.solve(bend, slope) if abs(np.linalg.det(bend)) > 1e-12 else np.full(2, np.inf)
