"""Sections from places and from chainages."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.discharge.cross_section import between, referenced


def test_chainage_is_measured_along_the_line() -> None:
    along = np.array([0.6, 0.8])
    zigzag = np.array([0.0, 0.3, -0.3, 0.3, 0])[:, None] * np.array([0.8, -0.6])
    section = referenced(np.array([100.0, 200]) + np.array([0.0, 3, 5, 8, 12])[:, None] * along + zigzag, np.zeros(5))
    assert section.chainage_m == pytest.approx([0, 3, 5, 8, 12], abs=0.05)
    assert section.along == pytest.approx(along, abs=0.03)
    assert np.abs(section.offset_m).max() == pytest.approx(0.3, abs=0.1)


def test_unordered_points_are_put_in_order() -> None:
    section = referenced(np.array([[0.0, 0], [4, 0], [2, 0], [6, 0]]), np.array([0.0, 2, 1, 3]))
    assert section.bed_m.tolist() == [0, 1, 2, 3]


def test_both_ways_give_one_section() -> None:
    s, bed = np.array([1.0, 2, 4, 7]), np.array([3.0, 1, 1, 3])
    chained = between(np.array([10.0, 20]), np.array([13.0, 24]), s, bed, 1.0)
    placed = referenced(np.array([10.0, 20]) + (s - 1)[:, None] * np.array([0.6, 0.8]), bed)
    assert chained.position_m == pytest.approx(placed.position_m)
    assert np.diff(chained.chainage_m) == pytest.approx(np.diff(placed.chainage_m))
    assert chained.normal == pytest.approx(placed.normal)


@pytest.mark.parametrize(("make", "says"), [
    (lambda: referenced(np.zeros((2, 2)), np.zeros(2)), "at least 3"),
    (lambda: referenced(np.zeros((4, 2)), np.zeros(4)), "reach across"),
    (lambda: referenced(np.array([[0.0, 0], [1, 0], [np.nan, 0]]), np.zeros(3)), "not finite"),
    (lambda: between(np.zeros(2), np.zeros(2), np.arange(3.0), np.zeros(3)), "two places"),
    (lambda: between(np.zeros(2), np.ones(2), np.arange(3.0), np.array([0, np.inf, 0])), "not finite"),
])
def test_no_sections(make: object, says: str) -> None:
    assert callable(make)
    with pytest.raises(InputError, match=says):
        make()
