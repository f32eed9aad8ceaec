"""Peaks of score maps to a fraction of a pixel, and areas of a picture, against what is known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from truth import SIZE, picture, similarity, translation

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray
from stab_ros.methods import _agreement, _peaks, _places
from stab_ros.methods._areas import Maps, sample

EVERYWHERE = np.ones(SIZE[::-1], bool)


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
def test_no_peak_is_no_number(estimator: object) -> None:
    assert callable(estimator)
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


def test_areas_are_exact_where_the_picture_is_a_parabola() -> None:
    y, x = np.mgrid[:60, :80].astype(np.float32)
    H = similarity(7.0, 1.1, 2.3, -1.4, (80, 60))
    maps = Maps.through(H, np.array([[40.5, 30.5], [37.0, 28.0]]))
    areas = sample(0.05 * x * x + 0.3 * x * y - 0.02 * y * y + x - 2 * y, maps, 9)
    v, u = np.mgrid[:9, :9] - 4.0
    for area, centre in zip(areas, [[40.5, 30.5], [37.0, 28.0]], strict=True):
        places = apply(H, np.stack([u.ravel(), v.ravel()], axis=1) + centre)  # H is affine, its map is exact
        px, py = places.T
        expected = 0.05 * px * px + 0.3 * px * py - 0.02 * py * py + px - 2 * py
        np.testing.assert_allclose(area.ravel(), expected, rtol=2e-5, atol=2e-3)


def test_areas_touch_the_homography() -> None:
    H = np.array([[1.01, 0.02, 3.0], [-0.01, 0.98, -2.0], [2e-5, -3e-5, 1.0]])
    centres = np.array([[100.0, 50.0], [300.0, 250.0]])
    maps, tiny = Maps.through(H, centres), 1e-3
    for axis in (0, 1):
        step = tiny * np.eye(2)[axis]
        slope = (apply(H, centres + step) - apply(H, centres - step)) / (2 * tiny)
        np.testing.assert_allclose(maps.shape[:, :, axis], slope, atol=1e-8)


def test_areas_beyond_the_picture_are_told_and_never_read_it() -> None:
    centres = np.array([[10.0, 10.0], [9.9, 10.0], [np.nan, 5.0], [1e300, 0.0], [np.inf, -np.inf]])
    maps = Maps.standing(centres)
    assert maps.inside(picture(), 21).tolist() == [True, False, False, False, False]
    assert np.isfinite(sample(picture(), maps, 21)).all()


def test_correlation_is_pearsons() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(100, 20, (5, 9, 9)), rng.normal(90, 10, (5, 9, 9))
    b[3] = 7.0
    alike = _agreement.correlation(a, b)
    expected = [np.corrcoef(a[i].ravel(), b[i].ravel())[0, 1] for i in (0, 1, 2, 4)]
    np.testing.assert_allclose(alike[[0, 1, 2, 4]], expected)
    assert alike[3] == 0


def test_an_edge_fixes_one_direction_only() -> None:
    x = np.arange(21.0) - 10
    edge = np.tile(40 * np.tanh(x / 2), (1, 21, 1)) + 0.05 * x[:, None] ** 2
    information = _agreement.information(edge, np.array([0.95]), _agreement.structure(edge), 1.0, np.array([0.0]))
    assert information[0, 0, 0] > 50 * information[0, 1, 1] > 0


def test_places_given_are_kept_to_half_a_pixel() -> None:
    points = np.array([[100.2, 50.7], [33.5, 20.0]])
    for side in (32, 21):
        centres = _places.manual(points, side)
        assert np.abs(centres - points).max() <= 0.5
        corners = centres - (side - 1) / 2
        np.testing.assert_array_equal(corners, np.round(corners))


def test_one_place_near_each_corner_of_what_is_allowed() -> None:
    allowed = EVERYWHERE.copy()
    allowed[:, :150] = False
    places = _places.corners(picture(), allowed, 4, 32, 16, 0.5)
    np.testing.assert_allclose(places, [[150, 16], [400, 16], [150, 284], [400, 284]], atol=75)
    assert all(allowed[int(y), int(x)] for x, y in places)
    assert _places.corners(picture(), np.zeros_like(allowed), 4, 32, 16, 0.5).shape == (0, 2)


def test_places_apart_keep_their_distance_and_margin() -> None:
    places = _places.apart(picture(), EVERYWHERE, 50, 21, 16, 60.0)
    assert 5 <= len(places) <= 30
    apart = np.hypot(*(places[:, None] - places[None]).T) + 1e9 * np.eye(len(places))
    assert apart.min() >= 59
    assert (places >= 16).all()
    assert (places <= np.array(SIZE) - 17).all()


def test_a_shift_is_a_shift() -> None:
    maps = Maps.standing(np.array([[50.0, 60.0]])).moved(np.array([[1.5, -2.0]]), np.zeros((1, 2, 2)))
    np.testing.assert_array_equal(maps.centres, apply(translation(1.5, -2.0), np.array([[50.0, 60.0]])))
