"""Brightness changes that are known exactly."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stab_ros.metrics.brightness import brightness


@pytest.mark.parametrize(("gain", "offset"), [(1.05, 0), (1, 8), (0.9, 0), (1, -10)])
def test_a_change_of_brightness_is_measured_and_undone(gain: float, offset: float) -> None:
    a = np.random.default_rng(1).uniform(60, 160, (5, 31, 31))
    found = brightness(a, gain * a + offset)
    assert (found.gain, found.offset) == pytest.approx((gain, offset), abs=1e-9)
    assert found.change == pytest.approx(np.median((gain * a + offset).mean(axis=(1, 2)) / a.mean(axis=(1, 2))) - 1)
    assert found.matched(gain * a + offset) == pytest.approx(a)


def test_blur_and_one_moving_window_are_no_change_of_brightness() -> None:
    a = np.random.default_rng(2).uniform(60, 160, (5, 31, 31))
    b = np.stack([cv2.blur(window, (3, 3)) for window in a])
    b[2] += 60
    found = brightness(a, b)
    assert abs(found.change) < 0.005
    assert abs(found.gain - 1) < 0.01
    assert abs(found.offset) < 0.5
