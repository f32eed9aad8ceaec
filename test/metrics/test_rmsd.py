"""RMSD by hand and by plain loops."""

from __future__ import annotations

import numpy as np
import pytest
from truth import IDENTITY, picture, translation

from stab_ros.metrics.rmsd import cut, rmsd

SIZE = (640, 480)
CENTRES = np.array([[60, 50], [320, 240], [590, 400], [200, 33]])


def test_rmsd_of_four_numbers_by_hand() -> None:
    """Differences 1, 2, 2 and 4 have squares of 1 + 4 + 4 + 16 = 25, a mean of 6.25 and a root of 2.5."""
    a, b = np.array([[[10, 20], [30, 40.0]]]), np.array([[[11, 18], [32, 36.0]]])
    assert rmsd(a, b) == pytest.approx([2.5])


@pytest.mark.parametrize("window_px", [1, 15, 31, 51])
def test_rmsd_of_pictures_by_plain_loops(window_px: int) -> None:
    a, b = picture(IDENTITY, SIZE), picture(translation(0.7, -0.4), SIZE, gain=1.1)
    expected = []
    for x, y in CENTRES.tolist():
        half = window_px // 2
        total = sum((int(a[y + i, x + j]) - int(b[y + i, x + j])) ** 2
                    for i in range(-half, half + 1) for j in range(-half, half + 1))
        expected.append((total / window_px**2) ** 0.5)
    assert rmsd(cut(a, CENTRES, window_px), cut(b, CENTRES, window_px)) == pytest.approx(expected, rel=1e-12)


def test_what_differs_by_a_constant_differs_by_it() -> None:
    a = picture(IDENTITY, SIZE)
    assert rmsd(cut(a, CENTRES, 31), cut(a, CENTRES, 31) + 3) == pytest.approx(3)


@pytest.mark.parametrize(("centre", "window_px"), [((14, 50), 31), ((50, 14), 31), ((625, 50), 31), ((50, 465), 31),
                                                   ((50, 50), 30), ((50, 50), 0)])
def test_windows_that_are_even_or_leave_the_picture_are_refused(centre: tuple[int, int], window_px: int) -> None:
    with pytest.raises(ValueError, match="window of"):
        cut(picture(IDENTITY, SIZE), np.array([centre]), window_px)
    with pytest.raises(ValueError, match="one shape"):
        rmsd(np.zeros((1, 3, 3)), np.zeros((1, 5, 5)))
