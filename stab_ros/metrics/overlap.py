"""Valid part of a stabilized image: measurements are limited to its overlap with the reference."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, Gray, Homography, IdArray

_MARGIN_PX = 2  # pixels next to the black border are affected by interpolation
_BLOCK = np.ones((5, 5), np.uint8)  # smallest black area that counts as border
_WIDER = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
_AROUND_PX = 8
_SHIFT = 4  # fractional bits of fillConvexPoly


def valid_overlap(gray: Gray, ref_H_cur: Homography | None) -> BoolArray:
    """Mask (h, w) bool of the valid pixels of a stabilized image `gray` (h, w) uint8.

    Excluded are black border areas and, if `ref_H_cur` is known, pixels outside the frame's footprint.
    """
    valid = ~_black_areas(gray)
    if ref_H_cur is not None:
        valid &= _footprint(ref_H_cur, (gray.shape[1], gray.shape[0]))
    return valid


def _black_areas(gray: Gray) -> BoolArray:
    """Areas of zeros, dilated; the image is extended at its border, so that thin black wedges count, too."""
    around = cv2.copyMakeBorder(gray, _AROUND_PX, _AROUND_PX, _AROUND_PX, _AROUND_PX, cv2.BORDER_REPLICATE)
    areas = cv2.morphologyEx(cv2.compare(around, 0, cv2.CMP_EQ), cv2.MORPH_OPEN, _BLOCK)
    return np.asarray(cv2.dilate(areas, _WIDER)[_AROUND_PX:-_AROUND_PX, _AROUND_PX:-_AROUND_PX] > 0)


def _footprint(ref_H_cur: Homography, size: tuple[int, int]) -> BoolArray:
    """Footprint (h, w) bool of the frame of `size` (width, height) in the reference, without a margin."""
    near, right, bottom = _MARGIN_PX, size[0] - 1 - _MARGIN_PX, size[1] - 1 - _MARGIN_PX
    corners = np.array([[near, near], [right, near], [right, bottom], [near, bottom]], float)
    if np.array_equal(ref_H_cur, np.eye(3)):
        return np.ones((size[1], size[0]), bool)
    canvas = np.zeros((size[1], size[0]), np.uint8)
    outline = np.clip(apply(ref_H_cur, corners), -1e6, 1e6)
    cv2.fillConvexPoly(canvas, np.round(outline * 2**_SHIFT).astype(np.int32), 1, shift=_SHIFT)
    return canvas.astype(bool)


def windows_inside(valid: BoolArray, centres_px: IdArray, window_px: int) -> BoolArray:
    """(P,) bool: whether each window of `window_px` about `centres_px` (P, 2) lies completely in `valid` (h, w)."""
    before, after = window_px // 2, window_px - window_px // 2
    height, width = valid.shape
    return np.array([
        x >= before and y >= before and x + after <= width and y + after <= height
        and valid[y - before : y + after, x - before : x + after].all()
        for x, y in centres_px.tolist()
    ], bool)
