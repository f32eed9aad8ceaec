"""Water off static ground."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray
from stab_ros.velocimetry.shore import off_ground


def _stream(width_px: int) -> BoolArray:
    ground = np.ones((100, 60), bool)
    ground[20 : 20 + width_px] = False
    return ground


def test_windows_on_what_is_left_show_no_ground() -> None:
    ground = _stream(60)
    left = off_ground(ground, 31)
    assert np.array_equal(np.flatnonzero(left.any(axis=1)), np.arange(35, 65))
    for row, column in np.argwhere(left)[::37]:
        assert not ground[row - 15 : row + 16, max(column - 15, 0) : column + 16].any()


def test_a_stream_narrower_than_a_window_is_kept() -> None:
    ground = _stream(25)
    assert np.array_equal(off_ground(ground, 31), ~ground)


def test_without_ground_all_is_water() -> None:
    assert off_ground(np.zeros((40, 50), bool), 31).all()
