"""The valid part of a stabilized image, and windows inside it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from truth import SIZE, picture, similarity, translation

from stab_ros.metrics.overlap import valid_overlap, windows_inside

GRAY = np.maximum(picture(), 1)


@pytest.mark.parametrize("H", [translation(12.3, -7.6), similarity(4.0, 0.95, 5, 3)])
def test_only_what_warping_filled_from_the_frame_is_valid(H: np.ndarray) -> None:
    white = cv2.warpPerspective(np.full(SIZE[::-1], 200, np.uint8), H, SIZE)
    warped = cv2.warpPerspective(GRAY, H, SIZE)
    inner = np.pad(np.ones((SIZE[1] - 2, SIZE[0] - 2), bool), 1)  # a wedge less than a pixel high is seen by H alone
    for known, where in ((H, np.ones_like(inner)), (None, inner)):
        valid = valid_overlap(warped, known)
        assert (white[valid & where] == 200).all(), "black border is mixed in"
        deep_inside = cv2.copyMakeBorder(white, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        deep_inside = cv2.erode(deep_inside, np.ones((17, 17), np.uint8))[1:-1, 1:-1] == 200
        assert valid[deep_inside].all(), "more than the border is left out"


def test_a_dark_pixel_is_not_border() -> None:
    dark = GRAY.copy()
    dark[50:53, 60:63] = 0
    assert valid_overlap(dark, None).all()


def test_windows_must_lie_inside() -> None:
    valid = np.ones((100, 120), bool)
    valid[40:42, 50] = False
    centres = np.array([[15, 15], [14, 50], [104, 84], [105, 84], [60, 41], [66, 41], [35, 41], [34, 41]])
    assert windows_inside(valid, centres, 31).tolist() == [True, False, True, False, False, True, False, True]
    assert windows_inside(valid, centres[:0], 31).shape == (0,)
