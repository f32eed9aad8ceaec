"""What features share shows in the covariance: correlated errors, a second plane among them, sampling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from truth import IDENTITY, SIZE

from stab_ros.core.geometry import rms_distance, sigma_px
from stab_ros.core.types import Correspondences, Fit, FloatArray
from stab_ros.estimation.aliasing import with_aliasing
from stab_ros.estimation.estimators import fit

SIGMA_PX, FEATURES, DRAWS = 0.05, 1200, 60
Errors = Callable[[FloatArray, np.random.Generator], FloatArray]


def scattered(places: FloatArray, draw: np.random.Generator) -> FloatArray:
    return np.asarray(draw.normal(0, SIGMA_PX, places.shape))


def in_blocks(places: FloatArray, draw: np.random.Generator) -> FloatArray:
    """As of a codec that moves blocks of a sixth of the picture."""
    column, row = (places / np.array(SIZE) * 6).astype(int).clip(0, 5).T
    return np.asarray(scattered(places, draw) + draw.normal(0, SIGMA_PX, (36, 2))[row * 6 + column])


def in_rows(places: FloatArray, draw: np.random.Generator) -> FloatArray:
    """As of a rolling shutter: a twentieth of the rows goes astray together."""
    band = (places[:, 1] / SIZE[1] * 20).astype(int).clip(0, 19)
    return np.asarray(scattered(places, draw) + draw.normal(0, SIGMA_PX, (20, 2))[band])


def fitted(reference: FloatArray, current: FloatArray, trust: FloatArray | None = None) -> Fit:
    pairs = Correspondences(np.arange(len(current)), reference, current,
                            np.tile(np.eye(2) / SIGMA_PX**2, (len(current), 1, 1)))
    found = fit(pairs, "projective", "magsac", 0.5, IDENTITY, trust)
    assert found is not None
    return found


@pytest.mark.parametrize("errors", [scattered, in_blocks, in_rows])
def test_sigma_is_as_large_as_errors_that_neighbours_share(errors: Errors) -> None:
    draw, off, sigma = np.random.default_rng(1), [], []
    for _ in range(DRAWS):
        current = draw.uniform(0, 1, (FEATURES, 2)) * (np.array(SIZE) - 1)
        found = fitted(current + errors(current, draw), current)
        off.append(rms_distance(found.ref_H_cur, IDENTITY, SIZE))
        sigma.append(sigma_px(found.ref_H_cur, found.covariance, SIZE))
    assert 0.75 < np.sqrt(np.mean(np.square(off)) / np.mean(np.square(sigma))) < 1.2


def test_what_has_no_weight_among_the_ground_counts() -> None:
    """Two planes half a px apart, each everywhere: whichever is trusted, the other can be the ground as well."""
    draw = np.random.default_rng(2)
    current = draw.uniform(0, 1, (FEATURES, 2)) * (np.array(SIZE) - 1)
    trust = (np.arange(FEATURES) % 2).astype(float)
    reference = current + scattered(current, draw)
    alike = fitted(reference, current, trust)
    apart = fitted(reference + np.outer(1 - trust, [0.5, 0.0]), current, trust)
    assert rms_distance(apart.ref_H_cur, IDENTITY, SIZE) < 0.05
    assert sigma_px(alike.ref_H_cur, alike.covariance, SIZE) < 0.02
    assert 0.1 < sigma_px(apart.ref_H_cur, apart.covariance, SIZE) < 0.5


def test_water_beside_the_ground_does_not_count() -> None:
    draw = np.random.default_rng(3)
    current = draw.uniform(0, 1, (FEATURES, 2)) * (np.array(SIZE) - 1)
    water = current[:, 1] > SIZE[1] / 2
    reference = current + scattered(current, draw)
    reference[water] += [0.5, 0.0]
    found = fitted(reference, current, np.where(water, 0.0, 1.0))
    still = fitted(reference[~water], current[~water])
    assert rms_distance(found.ref_H_cur, still.ref_H_cur, SIZE) < 1e-6
    assert sigma_px(still.ref_H_cur, still.covariance, SIZE) < 0.03
    assert sigma_px(found.ref_H_cur, found.covariance, SIZE) < 0.1  # there is water in cells of the bank


def test_sampling_counts_where_all_move_alike() -> None:
    current = np.random.default_rng(4).uniform(0, 1, (FEATURES, 2)) * (np.array(SIZE) - 1)
    told = {}
    for name, reference in (("alike", current + np.array([3.3, 0.2])), ("differing", current * 1.03)):
        pairs = Correspondences(np.arange(FEATURES), reference, current, np.tile(np.eye(2) * 1e8, (FEATURES, 1, 1)))
        found = fit(pairs, "projective", "magsac", 0.5, IDENTITY)
        assert found is not None
        told[name] = sigma_px(found.ref_H_cur, with_aliasing(found, pairs).covariance, SIZE)
    assert 0.003 < told["alike"] < 0.006
    assert told["differing"] < 0.001
