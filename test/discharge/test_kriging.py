"""Kriging beside conditional normal distributions, which are computed in another way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from stab_ros.core.types import FloatArray
from stab_ros.discharge.kriging import Kriging

KNOWN, WANTED, LENGTH = np.array([1.0, 2.0, 2.5, 4.0, 5.5, 6.0]), np.array([0.0, 3.0, 7.0, 60.0]), 3.0
NUGGET = np.array([0.01, 0.02, 0.3, 0.01, 0.05, 0.01])
VALUES = np.array([1.0, 1.3, 1.1, 1.9, 1.7, 1.6])
KRIGING = Kriging.of(KNOWN, WANTED, LENGTH, NUGGET)


def covariance(first: FloatArray, second: FloatArray) -> FloatArray:
    away = np.abs(np.subtract.outer(first, second)) / LENGTH
    return np.asarray((1 + away + away**2 / 3) * np.exp(-away))


def test_is_the_conditional_mean_and_variance_with_a_mean_of_which_nothing_is_known() -> None:
    vague = 1e6
    inner = covariance(KNOWN, KNOWN) + np.diag(NUGGET) + vague
    between = covariance(WANTED, KNOWN) + vague
    assert VALUES @ KRIGING.weights == pytest.approx(between @ np.linalg.solve(inner, VALUES), rel=1e-4)
    variance = np.diag(covariance(WANTED, WANTED) + vague - between @ np.linalg.solve(inner, between.T))
    assert KRIGING.variance == pytest.approx(variance, rel=1e-3)


def test_likelihood_is_that_of_contrasts() -> None:
    contrasts = null_space(np.ones((1, len(KNOWN))))

    def expected(values: FloatArray, nugget: FloatArray) -> float:
        inner = contrasts.T @ (covariance(KNOWN, KNOWN) + np.diag(nugget)) @ contrasts
        seen = contrasts.T @ values
        scale = seen @ np.linalg.solve(inner, seen) / len(seen)
        return float(multivariate_normal(np.zeros(len(seen)), scale * inner).logpdf(seen))

    first, second = VALUES, np.cos(KNOWN)
    other = Kriging.of(KNOWN, WANTED, LENGTH, 10 * NUGGET)
    found = KRIGING.log_likelihood(first) - other.log_likelihood(second)
    assert found == pytest.approx(expected(first, NUGGET) - expected(second, 10 * NUGGET))


def test_sigma_is_that_of_the_errors() -> None:
    rng, places = np.random.default_rng(0), np.concatenate([KNOWN, WANTED])
    root = np.linalg.cholesky(covariance(places, places) + 1e-9 * np.eye(len(places)))
    ratios = []
    for _ in range(2000):
        drawn = 2 + 0.3 * root @ rng.normal(size=len(places))
        known = drawn[: len(KNOWN)] + 0.3 * np.sqrt(NUGGET) * rng.normal(size=len(KNOWN))
        ratios.append((known @ KRIGING.weights - drawn[len(KNOWN) :]) / KRIGING.sigma(known))
    assert np.mean(np.abs(ratios) < 2) == pytest.approx(0.95, abs=0.02)


def test_a_constant_stays_one_and_one_value_tells_no_sigma() -> None:
    assert np.ones(len(KNOWN)) @ KRIGING.weights == pytest.approx(np.ones(len(WANTED)))
    alone = Kriging.of(KNOWN[:1], WANTED, LENGTH, NUGGET[:1])
    assert alone.sigma(VALUES[:1]) == pytest.approx(np.zeros(len(WANTED)), abs=1e-6)
