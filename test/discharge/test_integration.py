"""Wetted geometry and the two ways to add up verticals, against figures by hand and against plain trapezoids."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.discharge.integration import mean_section, mid_section
from stab_ros.discharge.wetted import DRY, area_m2, channels, shores_m, wet_lengths_m


def test_rectangular_channel_is_velocity_times_area() -> None:
    s, h, v = np.array([0.0, 2, 5, 6, 10]), np.full(5, 2.0), np.full(5, 1.5)
    for method in (mid_section, mean_section):
        assert method(s, h, v).sum() == pytest.approx(1.5 * 2 * 10)
    assert area_m2(s, h) == pytest.approx(20)


def test_vertical_walls_as_in_the_example_of_usgs_ivytools() -> None:
    s, v, h = np.array([0.0, 3, 7, 9, 10]), np.array([2.0, 3, 4, 5, 6]), np.array([1.0, 2, 3, 4, 5])
    assert mid_section(s, h, v).tolist() == pytest.approx([3, 21, 36, 30, 15])
    assert mid_section(s, h, v).sum() == pytest.approx(105)


def test_shores_lie_where_the_bed_crosses_the_water() -> None:
    s, h = np.array([0.0, 4, 8, 12]), np.array([-1.0, 1, 1, -3])
    assert wet_lengths_m(s, h).tolist() == pytest.approx([2, 4, 1])
    assert area_m2(s, h) == pytest.approx(0.5 * 2 + 4 + 0.5 * 1)
    assert shores_m(s, h, h > 0).tolist() == pytest.approx([2, 9])
    assert wet_lengths_m(s, np.array([-1.0, -2, -0.5, -1])).sum() == 0


@pytest.mark.parametrize("seed", range(5))
def test_mid_section_equals_trapezoids_over_the_wet_polygon(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s, h = np.cumsum(rng.uniform(0.5, 2, 20)), rng.normal(0.5, 1, 20)
    v = rng.uniform(0, 2, 20)
    places, products = [], []
    for i in range(19):
        places.append(s[i])
        products.append(v[i] * max(h[i], 0))
        if h[i] * h[i + 1] < 0:
            places.append(s[i] + (s[i + 1] - s[i]) * h[i] / (h[i] - h[i + 1]))
            products.append(0.0)
    places.append(s[-1])
    products.append(v[-1] * max(h[-1], 0))
    trapezoids = sum((products[i] + products[i + 1]) / 2 * (places[i + 1] - places[i]) for i in range(len(places) - 1))
    assert mid_section(s, h, v).sum() == pytest.approx(trapezoids)


def test_mean_section_takes_means_of_each_interval() -> None:
    s, h, v = np.array([0.0, 1, 3, 4]), np.array([0.0, 1, 2, 0]), np.array([9.0, 1, 2, 9])
    by_hand = 0.5 * 0.5 * 1 + 1.5 * 1.5 * 2 + 1 * 1 * 1  # at both shores velocity and depth are 0
    assert mean_section(s, h, v).sum() == pytest.approx(by_hand)


def test_an_island_parts_two_channels() -> None:
    h = np.array([-1.0, 1, 2, -0.5, -1, 1, -1])
    assert channels(h).tolist() == [DRY, 0, 0, DRY, DRY, 1, DRY]
    s = np.arange(7.0)
    assert shores_m(s, h, channels(h) == 1).tolist() == pytest.approx([4.5, 5.5])


def test_many_draws_at_once_are_single_ones() -> None:
    rng = np.random.default_rng(0)
    s, h, v = np.arange(9.0), rng.normal(0.5, 1, (4, 9)), rng.uniform(0, 1, (4, 9))
    for method in (mid_section, mean_section):
        assert np.allclose(method(s, h, v), [method(s, h[i], v[i]) for i in range(4)])
