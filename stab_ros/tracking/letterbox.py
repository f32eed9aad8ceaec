"""Bars at the edges of the picture, as a player or a stitched video leaves them, and the black around a round view.

Their edges are no ground.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, Gray

_MOST_DEVIATION = 3.0  # grey levels along a row of a bar, which compression has touched
_MOST_CHANGE = 6.0  # of its mean, from the outermost row on
_LEAST_PX = 3  # a bar
_MARGIN_PX = 16  # a patch and the soft edge of a bar
_ROUND = 0.9  # of the rectangle around it: a circle fills 0.785
_BLACK = 40  # grey levels, at most, of what surrounds a round view


def within_bars(gray: Gray) -> BoolArray:
    """(h, w) bool: what a picture, (h, w) uint8, shows inside of bars and round view; all of it without them."""
    shown = np.ones(gray.shape, bool)
    for lines, inside in ((gray, shown), (gray.T, shown.T)):
        first, last = _bar(lines), _bar(lines[::-1])
        if first + last < len(lines):
            inside[:first] = inside[len(lines) - last :] = False
    within = shown & ~_around(gray)
    return within if within.any() else shown


def _bar(lines: Gray) -> int:
    """Number of lines from the first one on that a bar and the margin take up; 0: there is no bar."""
    mean, width = float(lines[0].mean()), 0
    for line in lines:
        if line.std() > _MOST_DEVIATION or abs(float(line.mean()) - mean) > _MOST_CHANGE:
            break
        width += 1
    return width + _MARGIN_PX if width >= _LEAST_PX else 0


def _around(gray: Gray) -> BoolArray:
    """(h, w) bool: black that reaches into all four corners, with the margin; nowhere if one of them shows more."""
    corners = [gray[rows, columns] for rows in (slice(_LEAST_PX), slice(-_LEAST_PX, None))
               for columns in (slice(_LEAST_PX), slice(-_LEAST_PX, None))]
    levels = [float(corner.mean()) for corner in corners]
    textured = max(corner.std() for corner in corners) > _MOST_DEVIATION
    if textured or max(levels) > min(_BLACK, min(levels) + _MOST_CHANGE):
        return np.zeros(gray.shape, bool)
    _, part = cv2.connectedComponents((gray <= max(levels) + _MOST_CHANGE).astype(np.uint8), connectivity=4)
    black = np.isin(part, part[[0, 0, -1, -1], [0, -1, 0, -1]])
    if not _is_round(~black):
        return np.zeros(gray.shape, bool)
    margin = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1))
    return np.asarray(cv2.dilate(black.astype(np.uint8), margin) > 0)


def _is_round(shown: BoolArray) -> bool:
    """Whether the largest part of what is shown, (h, w) bool, is no rectangle between bars, which may hold text."""
    _, _, about, _ = cv2.connectedComponentsWithStats(shown.astype(np.uint8), connectivity=4)
    if len(about) < 2:
        return False
    width, height, area = about[1:][np.argmax(about[1:, cv2.CC_STAT_AREA])][[cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT,
                                                                            cv2.CC_STAT_AREA]]
    return bool(area < _ROUND * width * height)
