"""Sub-pixel peaks of score maps against Gaussians whose peaks are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stab_ros.core.types import FloatArray
from stab_ros.methods import _peaks


def gaussian(side: int, x: float, y: float, slant: float = 0.0) -> FloatArray:
    """(1, side, side) a Gaussian whose peak is (x, y) px from the middle."""
    v, u = np.mgrid[:side, :side] - side // 2
    dx, dy = u - x, v - y
    return np.asarray(0.8 * np.exp(-(0.12 * dx**2 + 0.2 * dy**2 + slant * dx * dy))[None])


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, -0.2), (-0.49, 0.49)])
def test_the_2x3_point_estimator_is_exact_on_a_gaussian(place: tuple[float, float]) -> None:
    np.testing.assert_allclose(_peaks.gaussian_2x3(gaussian(3, *place)), [place], atol=1e-12)


@pytest.mark.parametrize("side", [3, 5, 7])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, -0.2), (-0.49, 0.49)])
def test_the_fit_is_exact_on_a_slanted_gaussian(side: int, place: tuple[float, float]) -> None:
    np.testing.assert_allclose(_peaks.gaussian_fit(gaussian(side, *place, slant=0.15)), [place], atol=1e-5)


def test_a_larger_fit_averages_noise() -> None:
    rng = np.random.default_rng(3)
    near = np.concatenate([gaussian(7, 0.2, -0.1)] * 300) + rng.normal(0, 0.01, (300, 7, 7))
    spread = [np.std(_peaks.gaussian_fit(near[:, cut, cut]), axis=0).max() for cut in (np.s_[2:-2], np.s_[:])]
    assert spread[1] < 0.6 * spread[0]


@pytest.mark.parametrize("estimator", [_peaks.gaussian_2x3, _peaks.gaussian_fit])
def test_no_peak_is_no_number(estimator: Callable[[FloatArray], FloatArray]) -> None:
    saddle, border = np.ones((1, 3, 3)), gaussian(3, 0.1, 0.2)
    saddle[0, 0, 1] = saddle[0, 2, 1] = 1.5
    border[0, :, 0] = np.nan
    assert np.isnan(estimator(np.concatenate([saddle, border, np.ones((1, 3, 3))]))).any(axis=1).all()


def test_the_highest_peak_and_the_second() -> None:
    maps = np.zeros((2, 20, 30))
    maps[0, 5, 7], maps[0, 5, 8], maps[0, 15, 21] = 1.0, 0.9, 0.5  # the neighbour of a peak is none
    maps[1, 0, 29] = 0.7
    peaks = _peaks.highest(maps)
    assert (peaks.row.tolist(), peaks.column.tolist(), peaks.height.tolist()) == ([5, 0], [7, 29], [1.0, 0.7])
    np.testing.assert_array_equal(_peaks.ratio(maps, peaks), [2.0, np.inf])
    near = peaks.around(maps, 3)
    np.testing.assert_array_equal(near[0], maps[0, 4:7, 6:9])
    assert np.isnan(near[1]).sum() == 5
