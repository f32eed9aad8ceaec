"""Sub-pixel registration of windows in speckled images by normalized cross-correlation.

Under speckle, key points are accurate to a pixel at best. A window around one holds a thousand pixels, and its
correlation is accurate to a fraction of a pixel. It is computed on logarithms of local means, where speckle is additive
and nearly independent of brightness.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import BoolArray, Correspondences, Float32Array, FloatArray, Gray, Homography, IdArray

_BLUR_PX = 1.5
_SEARCH_PX = 4
# Number of pixels per independent sample after the blur. Calibrated against ground truth of synthetic flights; it holds
# for windows of 25 to 65 px and blurs of 1.5 to 3 px.
_CORRELATED_PX = 4.4 * np.pi * _BLUR_PX**2


@dataclass(frozen=True, eq=False)
class WindowMatches:
    """Correlation peaks of N windows.

    Attributes:
        displacement: (N, 2), px, reference side.
        information: (N, 2, 2) inverse covariance of the displacement, 1/px^2.
        correlation: (N,) at the peak.
        found: (N,) bool, whether there is a peak inside the search area.
    """

    displacement: FloatArray
    information: FloatArray
    correlation: FloatArray
    found: BoolArray


def logarithm(gray: Gray) -> Float32Array:
    """Logarithm of the local mean of an image (h, w) uint8: (h, w) float32."""
    mean = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), _BLUR_PX)
    return np.asarray(np.log(mean + 1))


def match_windows(reference: Float32Array, current: Float32Array, pairs: Correspondences, H: Homography, radius: int,
               min_correlation: float) -> Correspondences:
    """The pairs whose windows correlate near their positions under H, with `current_px` measured by the correlation.

    Args:
        reference: `logarithm` of the reference.
        current: `logarithm` of the current frame.
        pairs: correspondences of key points.
        H: `ref_H_cur` that the search starts from.
        radius: half the side of a window, px.
        min_correlation: windows with a lower correlation are dropped.
    """
    warped = cv2.warpPerspective(current, H, reference.shape[::-1], flags=cv2.INTER_LINEAR,
                                 borderMode=cv2.BORDER_REPLICATE)
    corner = np.round(pairs.reference_px).astype(np.int64)
    fits = _windows_inside(corner, H, radius + _SEARCH_PX, reference.shape)
    matches = _match_windows(reference, warped, corner[fits], radius)
    good = matches.found & (matches.correlation >= min_correlation)
    kept = np.flatnonzero(fits)[good]
    reference_px = pairs.reference_px[kept]
    current_px = apply(np.linalg.inv(H), reference_px + matches.displacement[good])
    return Correspondences(pairs.feature_id[kept], reference_px, current_px, matches.information[good])


def _windows_inside(corner: IdArray, H: Homography, reach: int, shape: tuple[int, ...]) -> BoolArray:
    """(n,) bool: whether each window with its search area lies inside both images."""
    cur_H_ref, size = np.linalg.inv(H), (shape[1], shape[0])
    ends = [corner + np.array([x, y]) for x in (-reach, reach) for y in (-reach, reach)]
    both = [inside(end, size) & inside(apply(cur_H_ref, end.astype(float)), size) for end in ends]
    return np.asarray(np.all(both, axis=0))


def _match_windows(reference: Float32Array, warped: Float32Array, corner: IdArray, radius: int) -> WindowMatches:
    n, samples = len(corner), (2 * radius + 1) ** 2 / _CORRELATED_PX
    matches = WindowMatches(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n), np.zeros(n, bool))
    for k, (x, y) in enumerate(corner.tolist()):
        scores = _scores(reference, warped, x, y, radius)
        row, column = np.unravel_index(scores.argmax(), scores.shape)
        if 0 < row < 2 * _SEARCH_PX and 0 < column < 2 * _SEARCH_PX:
            about = scores[row - 1 : row + 2, column - 1 : column + 2].astype(np.float64)
            curvature, offset = _paraboloid(about)
            matches.found[k] = np.linalg.eigvalsh(curvature)[0] > 0 and np.abs(offset).max() < 1
            matches.displacement[k] = np.array([column, row]) - _SEARCH_PX + offset
            matches.correlation[k] = about[1, 1]
            matches.information[k] = samples * curvature / max(1 - about[1, 1] ** 2, 1e-6)
    return matches


def _scores(reference: Float32Array, warped: Float32Array, x: int, y: int, radius: int) -> Float32Array:
    """Normalized cross-correlation at each displacement of the warped image's window, indexed by y, then x.

    It is the mean over both roles of window and search area; a single role would be biased even for identical images.
    """
    near, far = (np.s_[y - reach : y + reach + 1, x - reach : x + reach + 1]
                 for reach in (radius, radius + _SEARCH_PX))
    there = cv2.matchTemplate(warped[far], reference[near], cv2.TM_CCOEFF_NORMED)
    back = cv2.matchTemplate(reference[far], warped[near], cv2.TM_CCOEFF_NORMED)
    return np.asarray((there + back[::-1, ::-1]) / 2)


def _paraboloid(about: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Negative Hessian (2, 2) of 3x3 scores and the offset (2,), x and y, of the quadratic's peak from the centre."""
    xx = 2 * about[1, 1] - about[1, 0] - about[1, 2]
    yy = 2 * about[1, 1] - about[0, 1] - about[2, 1]
    xy = (about[0, 2] + about[2, 0] - about[0, 0] - about[2, 2]) / 4
    curvature = np.array([[xx, xy], [xy, yy]])
    slope = np.array([about[1, 2] - about[1, 0], about[2, 1] - about[0, 1]]) / 2
    return curvature, np.linalg.solve(curvature, slope) if abs(np.linalg.det(curvature)) > 1e-12 else np.full(2, np.inf)
