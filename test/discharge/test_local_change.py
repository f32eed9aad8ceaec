"""What vectors beside a place tell of the velocity there."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.core.types import FloatArray
from stab_ros.discharge.local_change import local_change

USUAL = np.array([0.5, 0.5, 0.2, 0.2])
TRUE = np.array([0.3, -0.1, 0.05, -0.08])


def surface(places_m: FloatArray) -> FloatArray:
    along, across = places_m.T
    return np.asarray(TRUE @ [along, across, along**2 / 2, across**2 / 2])


@pytest.mark.parametrize("from_m", [-2.0, 0.5])  # around the place, and on one side of it alone
def test_a_quadratic_surface_is_found(from_m: float) -> None:
    places = np.random.default_rng(0).uniform([from_m, -2], 2, (200, 2))
    found = local_change(places, 1.0 + surface(places), 3.0, USUAL)
    assert found.at(places) == pytest.approx(surface(places), abs=1e-3)


def test_wrong_vectors_do_not_count() -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(-2, 2, (200, 2))
    velocity = 1.0 + surface(places) + rng.normal(0, 0.01, 200)
    wrong = places[:, 0] > 1.2
    found = local_change(places, np.where(wrong, velocity + 5, velocity), 3.0, USUAL)
    assert found.at(places) == pytest.approx(surface(places), abs=0.1)


@pytest.mark.parametrize("vectors", [4, 8, 30])
def test_sigma_is_that_of_the_errors(vectors: int) -> None:
    """Also where the surface bends through nearly all of the vectors, so that hardly a residual tells their noise."""
    errors, sigmas = [], []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        places = rng.uniform([0, -1], [2, 1], (vectors, 2))
        found = local_change(places, 1.0 + surface(places) + rng.normal(0, 0.05, vectors), 3.0, USUAL)
        errors.append(float((found.at(places) - surface(places)).mean()))
        sigmas.append(found.sigma_m_s(places))
    assert np.mean(np.abs(errors) < 2 * np.array(sigmas)) > 0.8
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(sigmas))) < 1.3


def test_one_vector_tells_no_change_and_what_is_usual_is_its_sigma() -> None:
    place = np.array([[2.0, 0.0]])
    found = local_change(place, np.array([1.0]), 3.0, USUAL)
    assert found.at(place) == pytest.approx(0, abs=1e-6)
    assert found.sigma_m_s(place) == pytest.approx(np.hypot(0.5 * 2, 0.2 * 2), rel=0.01)
