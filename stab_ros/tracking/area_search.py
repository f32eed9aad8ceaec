"""Search around an expected position at full size: interrogation areas of the anchor frame, each in its search area.

A fine texture, as gravel, does not survive shrinking, so neither an image pyramid nor features of reduced images find
it again. Direct cross-correlation of areas as in particle image velocimetry does: an area of 64x64 px holds enough
grains to be told from its surroundings even where it is turned by some degrees. The areas that agree on one motion are
the initial guess. The number of areas is fixed, so that the cost does not grow with the size of the image.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import apply, inside, normalized, shift
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray, Image
from stab_ros.estimation import estimators
from stab_ros.estimation.models import minimal_points
from stab_ros.tracking import agreement

_AREA_PX = 64  # side of an interrogation area
_AREAS = 48
_PEAK = 5.0  # height of a correlation peak above the mean of its search area, in standard deviations
_THRESHOLD_PX = 4.0  # between areas: what a similarity leaves of a tilt
_PROJECTIVE_PX = 1.0
_DETERMINED = 4  # times as many areas as a homography needs


class AreaSearch:
    """Finds frames near an expected position in one anchor frame."""

    def __init__(self, anchor: Gray) -> None:
        """anchor: (h, w) uint8, not copied."""
        self._anchor = anchor

    def find(self, current: Gray, guess: Homography, ground_px: FloatArray, radius_px: int) -> Homography | None:
        """anchor_H_cur of a frame, (h, w) uint8; None where too few areas agree.

        guess: anchor_H_cur that is expected. ground_px: (N, 2) points of static ground in the anchor frame, around
        which areas are cut. radius_px: how far from the expected position they are searched for.
        """
        corners = self._corners(guess, ground_px)
        found = [self._displacement(current, guess, corner, radius_px) for corner in corners.tolist()]
        clear = np.array([peak >= _PEAK for _, peak in found], bool)
        if not clear.any():
            return None
        centres = (corners + (_AREA_PX - 1) / 2)[clear]
        seen_px = centres + np.array([moved for moved, _ in found])[clear]
        return _motion(centres, seen_px, guess, radius_px)

    def _corners(self, guess: Homography, ground_px: FloatArray) -> IdArray:
        """(n, 2) top left pixels of the areas: within the anchor frame and the view, spread over the ground."""
        height, width = self._anchor.shape
        corners = np.round(ground_px).astype(np.int64) - _AREA_PX // 2
        seen_px = apply(np.linalg.inv(guess), ground_px)
        fits = inside(corners.astype(float), (width - _AREA_PX + 1, height - _AREA_PX + 1))
        return _spread(corners[fits & inside(seen_px, (width, height))])

    def _displacement(self, current: Gray, guess: Homography, corner: list[int],
                      radius_px: int) -> tuple[FloatArray, float]:
        """Where one area is found relative to the expected position, px of the anchor, and how clear the peak is."""
        (x, y), side = corner, _AREA_PX + 2 * radius_px
        area = self._anchor[y : y + _AREA_PX, x : x + _AREA_PX]
        onto = shift(radius_px - x, radius_px - y) @ guess
        searched = cv2.warpPerspective(current, onto, (side, side), borderMode=cv2.BORDER_REFLECT_101)
        return _peak(cv2.matchTemplate(searched, area, cv2.TM_CCOEFF_NORMED))


def _spread(corners: IdArray) -> IdArray:
    """At most `_AREAS` of the points (n, 2), one in each cell of a grid over all of them."""
    if len(corners) <= _AREAS:
        return corners
    order = np.lexsort((corners[:, 0], corners[:, 1] * _AREAS // (np.ptp(corners[:, 1]) + 1)))
    return corners[order[:: -(-len(corners) // _AREAS)]]


def _peak(correlation: Image) -> tuple[FloatArray, float]:
    """Position of the highest correlation, (h, w), relative to the centre, px, and its height in deviations."""
    mean, deviation = cv2.meanStdDev(correlation)
    _, highest, _, (x, y) = cv2.minMaxLoc(correlation)
    height = (highest - float(mean[0, 0])) / max(float(deviation[0, 0]), 1e-6)
    inner = 0 < x < correlation.shape[1] - 1 and 0 < y < correlation.shape[0] - 1
    centre = (np.array(correlation.shape[::-1]) - 1) / 2
    return np.array([x, y]) - centre, height if inner else 0.0


def _motion(centres: FloatArray, seen_px: FloatArray, guess: Homography, radius_px: int) -> Homography | None:
    """`guess` corrected by what the areas agree on: centres (n, 2) expected, and seen at seen_px."""
    found = agreement.similarity(seen_px, centres, _THRESHOLD_PX, float((2 * radius_px + 1) ** 2))
    if found is None:
        return None
    correction, agrees = found
    return normalized(_tilted(centres[agrees], seen_px[agrees], correction) @ guess)


def _tilted(centres: FloatArray, seen_px: FloatArray, correction: Homography) -> Homography:
    """The similarity refined to a homography, where there are areas enough."""
    n = len(centres)
    if n < _DETERMINED * minimal_points("projective"):
        return correction
    pairs = Correspondences(np.arange(n), centres, seen_px, np.tile(np.eye(2) * 10.0, (n, 1, 1)))
    better = estimators.refine(pairs, "projective", _PROJECTIVE_PX, correction, np.ones(n))
    return correction if better is None else better
