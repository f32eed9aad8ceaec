"""Search at full size around an expected position: interrogation areas of a frame, each in a search area of another.

A fine texture, as gravel, does not survive shrinking, so neither an image pyramid nor features of reduced images find
it again. Direct cross-correlation of areas as in particle image velocimetry does: an area of 64x64 px holds enough
grains to be told from its surroundings even where it is turned by some degrees. The areas that agree on one motion are
the initial guess. The pixels searched are limited, so that the cost does not grow with the size of the image.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import apply, inside, normalized, shift
from stab_ros.core.types import FloatArray, Gray, Homography, IdArray, Image
from stab_ros.tracking import agreement

_AREA_PX = 64  # side of an interrogation area
_MOST_AREAS = 48
_SEARCHED_PX = 2_500_000  # of all search areas together
_PEAK = 5.0  # height of a correlation peak above the mean of its search area, in standard deviations
_THRESHOLD_PX = 4.0  # between areas: what a similarity leaves of a tilt


def find_by_areas(anchor: Gray, current: Gray, guess: Homography, ground_px: FloatArray,
                  radius_px: int) -> Homography | None:
    """anchor_H_cur of a frame near an expected position; None where too few areas agree.

    Args:
        anchor: (h, w) uint8.
        current: (h, w) uint8, the frame.
        guess: anchor_H_cur that is expected.
        ground_px: (N, 2) points of static ground in the anchor frame, around which areas are cut.
        radius_px: how far from the expected position they are searched for.
    """
    side = _AREA_PX + 2 * radius_px
    corners = _corners(anchor.shape, guess, ground_px, min(_MOST_AREAS, _SEARCHED_PX // side**2))
    found = [_displacement(anchor, current, guess, corner, radius_px) for corner in corners.tolist()]
    clear = np.array([height >= _PEAK for _, height in found], bool)
    if not clear.any():
        return None
    centres = (corners + (_AREA_PX - 1) / 2)[clear]
    seen_px = centres + np.array([moved for moved, _ in found])[clear]
    correction = agreement.motion(seen_px, centres, _THRESHOLD_PX, (2 * radius_px + 1) ** 2)
    return None if correction is None else normalized(correction @ guess)


def _corners(shape: tuple[int, ...], guess: Homography, ground_px: FloatArray, most: int) -> IdArray:
    """(n, 2) top left pixels of the areas: within the anchor frame and the view, spread over the ground."""
    height, width = shape
    corners = np.round(ground_px).astype(np.int64) - _AREA_PX // 2
    fits = inside(corners.astype(float), (width - _AREA_PX + 1, height - _AREA_PX + 1))
    fits &= inside(apply(np.linalg.inv(guess), ground_px), (width, height))
    return _spread(corners[fits], most)


def _spread(points: IdArray, most: int) -> IdArray:
    """At most so many of the points (n, 2): evenly along rows that are about as far apart."""
    if len(points) <= most:
        return points
    rows = max(1, round(most**0.5))
    row = (points[:, 1] - points[:, 1].min()) * rows // (np.ptp(points[:, 1]) + 1)
    order = np.lexsort((points[:, 0], row))
    return np.asarray(points[order[np.linspace(0, len(order) - 1, most).astype(int)]])


def _displacement(anchor: Gray, current: Gray, guess: Homography, corner: list[int],
                  radius_px: int) -> tuple[FloatArray, float]:
    """Where one area is found relative to the expected position, (2,) px of the anchor, and how clear that is."""
    (x, y), side = corner, _AREA_PX + 2 * radius_px
    onto = shift(radius_px - x, radius_px - y) @ guess
    searched = cv2.warpPerspective(current, onto, (side, side), borderMode=cv2.BORDER_REFLECT_101)
    return _peak(cv2.matchTemplate(searched, anchor[y : y + _AREA_PX, x : x + _AREA_PX], cv2.TM_CCOEFF_NORMED))


def _peak(correlation: Image) -> tuple[FloatArray, float]:
    """Position of the highest correlation, (h, w), relative to the centre, and its height in standard deviations."""
    mean, deviation = cv2.meanStdDev(correlation)
    _, highest, _, (x, y) = cv2.minMaxLoc(correlation)
    height = (highest - float(mean[0, 0])) / max(float(deviation[0, 0]), 1e-6)
    rows, columns = correlation.shape
    inner = 0 < x < columns - 1 and 0 < y < rows - 1  # at the border the true peak may lie beyond
    return np.array([x - (columns - 1) / 2, y - (rows - 1) / 2]), height if inner else 0.0
