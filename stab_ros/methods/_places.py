"""Where the template methods look: the user's points, or places they choose themselves."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.methods import spread

_QUALITY = 1e-3  # of the strongest Harris corner; weaker ones are none


def manual(points_px: FloatArray, side: int) -> FloatArray:
    """(n, 2) px: centres of the areas of `side` px nearest to the user's points (n, 2).

    Whole pixels, or, if `side` is even, half a pixel beside them: so the areas need not be interpolated.
    """
    half = (side - 1) / 2
    return np.round(points_px - half) + half


def even(gray: Gray, allowed: BoolArray, count: int, side: int, margin: int, min_texture: float) -> FloatArray:
    """(n, 2) px: at most `count` places, the best textured of each cell of an even grid.

    side: of the area, px. margin: px kept clear of the picture's border. min_texture: see `spread.texture`.
    """
    centres = spread.choose(gray, _clear(allowed, margin), count, side // 2, min_texture)
    return _centred(centres, side)


def corners(gray: Gray, allowed: BoolArray, count: int, side: int, margin: int, min_texture: float) -> FloatArray:
    """(n, 2) px: at most four places, and `count`, the best textured near each corner of what is allowed.

    Four points there determine a homography best, and a river seldom covers all four corners of its picture.
    """
    score = spread.texture(gray, side // 2)
    score[~_clear(allowed, margin)] = 0
    rows, columns = np.flatnonzero(score.any(axis=1)), np.flatnonzero(score.any(axis=0))
    if not len(rows):
        return np.empty((0, 2))
    box = score[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    found = [_best(part) + offset for part, offset in _quarters(box) if part.max(initial=0.0) >= min_texture]
    corner = np.array([columns[0], rows[0]])
    return _centred(corner + np.array(found[:count], np.int64).reshape(-1, 2), side)


def apart(gray: Gray, allowed: BoolArray, count: int, side: int, margin: int, distance_px: float) -> FloatArray:
    """(n, 2) px: at most `count` Harris corners, strongest first, no two of them nearer than `distance_px`."""
    mask = _clear(allowed, margin).astype(np.uint8)
    if not mask.any():
        return np.empty((0, 2))
    found = cv2.goodFeaturesToTrack(gray, count, _QUALITY, distance_px, mask=mask, useHarrisDetector=True)
    return np.empty((0, 2)) if found is None else _centred(np.round(found.reshape(-1, 2)).astype(np.int64), side)


def _clear(allowed: BoolArray, margin: int) -> BoolArray:
    clear = np.zeros_like(allowed)
    clear[margin : allowed.shape[0] - margin, margin : allowed.shape[1] - margin] = True
    return np.asarray(clear & allowed)


def _centred(centres: IdArray, side: int) -> FloatArray:
    """Centres of areas that begin `side` // 2 before whole pixels."""
    return centres - (0.5 if side % 2 == 0 else 0.0)


def _quarters(box: FloatArray) -> list[tuple[FloatArray, IdArray]]:
    """The outer quarter of each side at the four corners, or the whole quadrant where nothing is there; with (x, y)."""
    height, width = box.shape
    parts = []
    for below in (False, True):
        for right in (False, True):
            for share in (4, 2):
                h, w = max(1, height // share), max(1, width // share)
                y, x = (height - h) * below, (width - w) * right
                part = box[y : y + h, x : x + w]
                if part.any():
                    break
            parts.append((part, np.array([x, y])))
    return parts


def _best(score: FloatArray) -> IdArray:
    """Column and row of the highest score."""
    y, x = np.unravel_index(int(score.argmax()), score.shape)
    return np.array([x, y])


LAYOUT = {"even": even, "corners": corners}
LAYOUTS = tuple(LAYOUT)
LAYOUT_DOC = "where points lie, if none are given: evenly, or one near each corner"
