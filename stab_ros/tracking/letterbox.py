"""Bars at the edges of the picture, as a player or a stitched video leaves them: their edges are no ground."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray, Gray

_MOST_DEVIATION = 3.0  # grey levels along a row of a bar, which compression has touched
_MOST_CHANGE = 6.0  # of its mean, from the outermost row on
_LEAST_PX = 3  # a bar
_MARGIN_PX = 16  # a patch and the soft edge of a bar


def within_bars(gray: Gray) -> BoolArray:
    """(h, w) bool: what a picture, (h, w) uint8, shows inside of its bars; all of it where it has none."""
    shown = np.ones(gray.shape, bool)
    for lines, inside in ((gray, shown), (gray.T, shown.T)):
        first, last = _bar(lines), _bar(lines[::-1])
        if first + last < len(lines):
            inside[:first] = inside[len(lines) - last :] = False
    return shown


def _bar(lines: Gray) -> int:
    """Number of lines from the first one on that a bar and the margin take up; 0: there is no bar."""
    mean, width = float(lines[0].mean()), 0
    for line in lines:
        if line.std() > _MOST_DEVIATION or abs(float(line.mean()) - mean) > _MOST_CHANGE:
            break
        width += 1
    return width + _MARGIN_PX if width >= _LEAST_PX else 0
