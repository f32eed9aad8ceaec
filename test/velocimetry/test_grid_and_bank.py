"""Grid and bank check against draws with known errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.bank import bank_velocity
from stab_ros.velocimetry.grid import on_grid
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.vectors import Vectors

BANK = PlaneMask.of_polygons([np.array([[0.0, 0], [10, 0], [10, 2], [0, 2]])])
OWN, SHARED = 0.05, np.array([[0.02, 0.0], [0.01, 0.03]])


def drawn(n: int, rng: np.random.Generator, velocity: FloatArray | None = None) -> Vectors:
    """Vectors whose errors are drawn from what they claim."""
    start = rng.uniform([0.2, 0.2], [9.5, 1.5], (n, 2))
    common = SHARED @ rng.standard_normal(2)
    moved = (np.zeros(2) if velocity is None else velocity) + common + rng.normal(0, OWN, (n, 2))
    return Vectors(start, start + moved * 0.5, np.zeros(n, np.int64), np.full(n, 500_000_000),
                   np.tile(OWN**2 * np.eye(2), (n, 1, 1)), np.tile(SHARED, (n, 1, 1)), np.arange(n))


def test_a_still_bank_is_at_rest_in_99_of_100_draws_and_its_covariance_holds() -> None:
    rng = np.random.default_rng(5)
    found = [bank_velocity(drawn(40, rng), BANK) for _ in range(400)]
    assert 0.97 <= np.mean([one.at_rest for one in found]) <= 1.0
    medians = np.array([one.median_m_s for one in found])
    np.testing.assert_allclose(np.cov(medians.T), found[0].covariance, rtol=0.25, atol=1e-4)


def test_a_bank_that_moves_is_not_at_rest() -> None:
    assert bank_velocity(drawn(40, np.random.default_rng(6), np.array([0.3, 0.0])), BANK).at_rest is False


def test_nothing_on_the_bank_tells_nothing() -> None:
    vectors = drawn(10, np.random.default_rng(7))
    assert bank_velocity(vectors, BANK.inverted()).at_rest is None


def test_cells_hold_median_count_and_both_kinds_of_error() -> None:
    rng = np.random.default_rng(8)
    grids = [on_grid(drawn(400, rng, np.array([1.0, 0.2])), 1.0, least=5) for _ in range(40)]
    first = grids[0]
    assert first.count.sum() <= 400
    assert (first.count >= 5).all()
    assert ((first.centre_m > 0) & (first.centre_m < [10, 2])).all()
    np.testing.assert_allclose(first.shared_sigma_m_s, np.tile(np.hypot(*SHARED.T), (len(first.cell), 1)))
    ratio = np.concatenate([(one.median_m_s - [1.0, 0.2]) / one.sigma_m_s for one in grids])
    assert 0.9 <= (np.abs(ratio) < 2).mean() <= 0.99


def test_no_vectors_make_an_empty_grid() -> None:
    assert len(on_grid(drawn(0, np.random.default_rng(9)), 1.0).cell) == 0


def test_vectors_that_share_no_error_have_a_grid() -> None:
    vectors = drawn(50, np.random.default_rng(10))
    grid = on_grid(replace(vectors, shared=np.zeros((50, 2, 0))), 1.0)
    assert grid.count.sum() == 50
    assert not grid.shared_sigma_m_s.any()
    assert len(on_grid(replace(vectors, shared=np.zeros((50, 2, 0)))[:0], 1.0).cell) == 0


def test_masks_hold_what_lies_inside() -> None:
    places = np.array([[5.0, 1], [5, 3], [-1, 1], [np.nan, 1]])
    np.testing.assert_array_equal(BANK.holds(places), [True, False, False, False])
    with pytest.raises(InputError):
        PlaneMask.of_polygons([np.zeros((3, 2))])
