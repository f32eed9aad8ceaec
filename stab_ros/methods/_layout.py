"""Point selection of the template methods: the user's points, or well-textured points in a layout."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.methods import spread

_QUALITY = 1e-3  # smallest Harris response, as a share of the strongest corner's


def user_points(points_px: FloatArray, side: int) -> FloatArray:
    """Centres (n, 2), px, of the windows of `side` px nearest to the user's points (n, 2).

    Centres are whole pixels, or half pixels if `side` is even, so that the windows need no interpolation.
    """
    half = (side - 1) / 2
    return np.round(points_px - half) + half


def even(gray: Gray, allowed: BoolArray, count: int, side: int, margin: int, min_texture: float) -> FloatArray:
    """Centres (n, 2), px, of at most `count` windows: the best-textured one of each cell of a regular grid.

    Args:
        gray: (h, w) uint8.
        allowed: (h, w) bool, where centres may lie.
        count: largest number of windows.
        side: side of a window, px.
        margin: distance of the centres from the image border, px.
        min_texture: see `spread.texture`.
    """
    centres = spread.choose(gray, _with_margin(allowed, margin), count, side // 2, min_texture)
    return _centred(centres, side)


def corners(gray: Gray, allowed: BoolArray, count: int, side: int, margin: int, min_texture: float) -> FloatArray:
    """Centres (n, 2), px, of at most four windows: the best-textured one near each corner of the allowed region.

    Four points there determine a homography best, and a river rarely covers all four corners of the image. Arguments
    as for `even`.
    """
    score = spread.texture(gray, side // 2)
    score[~_with_margin(allowed, margin)] = 0
    rows, columns = np.flatnonzero(score.any(axis=1)), np.flatnonzero(score.any(axis=0))
    if not len(rows):
        return np.empty((0, 2))
    box = score[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    found = [_best(part) + offset for part, offset in _quarters(box) if part.max(initial=0.0) >= min_texture]
    corner = np.array([columns[0], rows[0]])
    return _centred(corner + np.array(found[:count], np.int64).reshape(-1, 2), side)


def strongest_corners(gray: Gray, allowed: BoolArray, count: int, side: int, margin: int,
                      distance_px: float) -> FloatArray:
    """Centres (n, 2), px, of at most `count` Harris corners, strongest first, at least `distance_px` apart.

    Other arguments as for `even`.
    """
    mask = _with_margin(allowed, margin).astype(np.uint8)
    if not mask.any():
        return np.empty((0, 2))
    found = cv2.goodFeaturesToTrack(gray, count, _QUALITY, distance_px, mask=mask, useHarrisDetector=True)
    return np.empty((0, 2)) if found is None else _centred(np.round(found.reshape(-1, 2)).astype(np.int64), side)


def _with_margin(allowed: BoolArray, margin: int) -> BoolArray:
    clear = np.zeros_like(allowed)
    clear[margin : allowed.shape[0] - margin, margin : allowed.shape[1] - margin] = True
    return np.asarray(clear & allowed)


def _centred(centres: IdArray, side: int) -> FloatArray:
    """Centres of windows that begin `side` // 2 px before the given pixels."""
    return centres - (0.5 if side % 2 == 0 else 0.0)


def _quarters(box: FloatArray) -> list[tuple[FloatArray, IdArray]]:
    """The four corner blocks and the (x, y) of their first pixel.

    A block is a quarter of the box wide and high, or half of it where the quarter has no texture.
    """
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
LAYOUT_DOC = "Layout of automatic points: spread evenly, or one near each corner of the region of interest"
