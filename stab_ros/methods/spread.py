"""Patch selection: the best-textured positions, spread evenly over the allowed region."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.kernels import BOOL, F32, I64, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray

_BORDER = 3  # px that the gradient and the interpolation read outside a patch
_BAND_ROWS = 128  # image rows processed together, so that intermediate results stay in the processor's cache
_SOBEL_REACH = 1


def texture(gray: Gray, radius: int) -> FloatArray:
    """Smaller eigenvalue of the structure tensor (Shi and Tomasi 1994) at each pixel, grey levels^2 per px^2.

    Args:
        gray: (h, w) uint8.
        radius: half the side of the window, px.

    Returns:
        (h, w) float32, the mean squared gradient in the window along its weaker direction.
    """
    side, height, reach = 2 * radius + 1, len(gray), radius + _SOBEL_REACH
    per_sobel = 1.0 / (4 * side * 255)  # OpenCV's scaling of its 3x3 Sobel for 8-bit images
    unit = np.float32((1 / (8 * per_sobel * side)) ** 2)
    found = np.empty(gray.shape, np.float32)

    def bands(first: int, last: int) -> None:
        for top in range(first * _BAND_ROWS, min(last * _BAND_ROWS, height), _BAND_ROWS):
            above, bottom = max(0, top - reach), min(top + _BAND_ROWS, height)
            eigenvalue = cv2.cornerMinEigenVal(gray[above : bottom + reach], side, ksize=3)
            np.multiply(eigenvalue[top - above : bottom - above], unit, out=found[top:bottom])

    in_parallel(bands, -(-height // _BAND_ROWS), least=1)
    return found


def choose(gray: Gray, allowed: BoolArray, count: int, radius: int, least_texture: float) -> IdArray:
    """Centres (n, 2) int64, px, of at most `count` patches: the best-textured position of each cell of a regular grid.

    The cell size is such that about `count` cells cover the allowed region.

    Args:
        gray: (h, w) uint8.
        allowed: (h, w) bool, where centres may lie.
        count: largest number of patches.
        radius: half the side of a patch, px.
        least_texture: minimum `texture` of a patch.
    """
    margin = radius + _BORDER
    usable = np.zeros(gray.shape, bool)
    usable[margin:-margin, margin:-margin] = allowed[margin:-margin, margin:-margin]
    side = max(radius, int(np.sqrt(np.count_nonzero(usable) / count)))
    best, centres = _best_of_cells(texture(gray, radius), usable, side)
    strongest = np.argsort(-best, kind="stable")[:count]
    return np.asarray(centres[np.sort(strongest[best[strongest] >= least_texture])])


@kernel((read(F32, 2), read(BOOL, 2), I64))
def _best_of_cells(score: FloatArray, usable: BoolArray, side: int) -> tuple[FloatArray, IdArray]:
    """The best score of the usable pixels of each cell of side^2 px, in row-major order, and its (x, y); 0 if none."""
    height, width = score.shape
    rows, columns = -(-height // side), -(-width // side)
    best, where = np.zeros(rows * columns, np.float32), np.zeros((rows * columns, 2), np.int64)
    for y in range(height):
        for column in range(columns):
            cell = y // side * columns + column
            for x in range(column * side, min((column + 1) * side, width)):
                if usable[y, x] and score[y, x] > best[cell]:
                    best[cell], where[cell, 0], where[cell, 1] = score[y, x], x, y
    return best, where


def within(centres: IdArray, shape: tuple[int, ...], radius: int) -> IdArray:
    """The centres (n, 2) that are as far from the border of an image of `shape` as `choose` requires."""
    margin = radius + _BORDER
    return centres[((centres >= margin) & (centres < np.array(shape[1::-1]) - margin)).all(axis=1)]
