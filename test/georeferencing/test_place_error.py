"""The two parts of the error of a placement."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stab_ros.core.covariance import factor
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.place_error import PlaceError, all_shared


def covariance(seed: int) -> FloatArray:
    """Of numbers as different as the entries of a homography."""
    rng = np.random.default_rng(seed)
    A = np.diag([1e-2, 1e-2, 5.0, 1e-2, 1e-2, 5.0, 1e-6, 1e-6]) @ rng.normal(size=(8, 12))
    return np.asarray(A @ A.T)


@given(st.integers(0, 10**6))
def test_factor_is_a_root_that_changes_steadily(seed: int) -> None:
    C = covariance(seed)
    F, scale = factor(C), np.sqrt(np.diag(C))
    np.testing.assert_allclose(F @ F.T / np.outer(scale, scale), C / np.outer(scale, scale), atol=1e-12)
    moved = factor(C * (1 + 1e-6))
    assert np.abs((moved - F) / scale[:, None]).max() < 1e-5


def test_factor_of_what_is_known_is_zero() -> None:
    C = np.zeros((8, 8))
    C[:2, :2] = [[4, 2], [2, 1]]
    F = factor(C)
    np.testing.assert_allclose(F @ F.T, C, atol=1e-12)
    assert not F[2:].any()


def test_parts_make_the_whole() -> None:
    C, J = covariance(1), np.random.default_rng(2).normal(size=(8, 8))
    error = all_shared(factor(C)).with_shared(np.arange(8.0))
    np.testing.assert_allclose(error.covariance, C + np.outer(np.arange(8.0), np.arange(8.0)), rtol=1e-9)
    np.testing.assert_allclose(error.mapped(J).covariance, J @ error.covariance @ J.T, rtol=1e-9, atol=1e-9)
    assert error.padded(12).shared.shape == (8, 12)
    np.testing.assert_array_equal(error.padded(12).covariance, error.covariance)


def test_own_part_is_taken_out_of_the_whole() -> None:
    C = covariance(3)
    split = PlaceError(C, np.zeros((8, 0))).seen_by(C / 10)
    np.testing.assert_array_equal(split.own, C / 10)
    scale = np.sqrt(np.diag(C))
    np.testing.assert_allclose(split.covariance / np.outer(scale, scale), C / np.outer(scale, scale), atol=1e-9)
