"""Windows that follow a known displacement."""

from __future__ import annotations

import numpy as np
import pytest
from truth import IDENTITY, picture, translation

from stab_ros.metrics.alignment import follow
from stab_ros.metrics.rmsd import cut, rmsd

SIZE = (640, 480)
CENTRES = np.array([[60, 50], [320, 240], [590, 400], [200, 33]])


@pytest.mark.parametrize(("x_px", "y_px"), [(0.3, -0.7), (2.5, 1.25), (0.0, 0.0), (-3.0, 1.0)])
def test_windows_that_follow_the_shift_show_the_same(x_px: float, y_px: float) -> None:
    a, b = picture(IDENTITY, SIZE, noise=0), picture(translation(-x_px, -y_px), SIZE, noise=0)
    shifts = np.tile([x_px, y_px], (len(CENTRES), 1))
    inner = CENTRES[1:3]
    followed = follow(b, inner, 31, shifts[1:3])
    assert rmsd(cut(a, inner, 31), followed).max() < 1.3  # of rounding and of what the grain holds near Nyquist
    if (x_px, y_px) != (0, 0):
        assert rmsd(cut(a, inner, 31), cut(b, inner, 31)).min() > 5


def test_what_has_no_shift_or_leaves_the_picture_is_not_followed() -> None:
    shifts = np.array([[0.5, 0.5], [np.nan, np.nan], [60.0, 0.0], [0.0, -15.0]])
    known = np.isfinite(follow(picture(IDENTITY, SIZE), CENTRES, 31, shifts)).all(axis=(1, 2))
    assert known.tolist() == [True, False, False, False]
