"""Medians at verticals and their standard deviation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_river import River

from stab_ros.discharge.cross_section import referenced
from stab_ros.discharge.surface import surface_velocities
from stab_ros.velocimetry.speeds import joined

EVEN = River(lambda s: 0 * s + 0.8)
WET = np.ones(5, np.bool_)
SECTION = referenced(np.column_stack([np.zeros(5), np.linspace(2, 18, 5)]), np.zeros(5))


def test_sigma_is_that_of_the_median() -> None:
    errors, sigmas = [], []
    for seed in range(60):
        vectors = EVEN.vectors(np.random.default_rng(seed), 1500, shared=0.0)
        found = surface_velocities(SECTION, WET, vectors, 1.0, 3)
        errors += (found.velocity_m_s - 0.8).tolist()
        sigmas += found.sigma_m_s.tolist()
    assert np.std(errors) == pytest.approx(np.mean(sigmas), rel=0.15)


def test_wrong_vectors_do_not_move_the_median_far() -> None:
    rng = np.random.default_rng(0)
    vectors = EVEN.vectors(rng, 1500, sigma_m_s=0.02, shared=0.0)
    wild = River(lambda s: 0 * s + 9.0).vectors(rng, 300, sigma_m_s=1.0, shared=0.0)
    both = surface_velocities(SECTION, WET, joined([vectors, wild]), 1.0, 3)
    assert both.velocity_m_s == pytest.approx(np.full(5, 0.8), abs=0.03)


def test_one_track_many_times_is_one_observation() -> None:
    vectors = EVEN.vectors(np.random.default_rng(0), 1500, shared=0.0)
    again = vectors[np.repeat(np.arange(1500), 4)]
    once, four = (surface_velocities(SECTION, WET, some, 1.0, 3) for some in (vectors, again))
    assert four.sigma_m_s == pytest.approx(once.sigma_m_s, rel=0.05)
    assert (four.count == 4 * once.count).all()


def test_shared_errors_are_carried_along() -> None:
    found = surface_velocities(SECTION, WET, EVEN.vectors(np.random.default_rng(0), shared=0.02), 1.0, 3)
    assert np.hypot(*found.shared_m_s.T) == pytest.approx(0.02 * 0.8, rel=0.01)


def test_errors_of_some_vectors_alone_count_as_much_as_they_move_the_mean() -> None:
    """Five intervals, each with an error of scale of 5 % of its own, in a column of its own: 5 % / sqrt(5) of all."""
    vectors = EVEN.vectors(np.random.default_rng(0), 20_000, sigma_m_s=0.01, shared=0.05)
    interval = np.arange(len(vectors)) % 5
    columns = vectors.shared[:, :, :1] * (interval[:, None, None] == np.arange(5))
    found = surface_velocities(SECTION, WET, replace(vectors, shared=columns), 1.0, 3)
    assert np.hypot.reduce(found.shared_m_s.mean(axis=0)) == pytest.approx(0.05 / np.sqrt(5) * 0.8, rel=0.01)


def test_too_few_vectors_and_dry_points_are_not_measured() -> None:
    vectors = EVEN.vectors(np.random.default_rng(0))
    found = surface_velocities(SECTION, np.array([True, False, True, True, True]), vectors, 1.0, 3)
    assert found.known.tolist() == [True, False, True, True, True]
    assert not surface_velocities(SECTION, WET, vectors, 1.0, 10_000).known.any()


SHEARED = River(lambda s: 0.1 * s)


def test_a_vertical_beside_all_vectors_has_the_velocity_that_they_lead_to() -> None:
    errors, sigmas = [], []
    for seed in range(60):
        vectors = SHEARED.vectors(np.random.default_rng(seed), 1500, sigma_m_s=0.05, shared=0.0)
        found = surface_velocities(SECTION, WET, vectors[vectors.position_m[:, 1] > 2.2], 1.0, 3)
        errors.append(found.velocity_m_s[0] - 0.2)
        sigmas.append(found.sigma_m_s[0])
    assert abs(np.mean(errors)) < 0.01
    assert 0.7 < np.std(errors) / np.mean(sigmas) < 1.3


def test_vectors_beyond_an_island_do_not_count() -> None:
    places = np.linspace(9, 11, 5)
    section = referenced(np.column_stack([np.zeros(5), places]), np.zeros(5))
    beside = River(lambda s: np.where(s < 10, 0.2, 1.0)).vectors(np.random.default_rng(0), 4000, shared=0.0)
    found = surface_velocities(section, np.array([True, True, False, True, True]), beside, 1.5, 3)
    assert found.velocity_m_s[[0, 1, 3, 4]] == pytest.approx([0.2, 0.2, 1.0, 1.0], abs=0.05)


def test_downstream_is_where_more_water_flows() -> None:
    rng = np.random.default_rng(0)
    flow = EVEN.vectors(rng, 1500, shared=0.0)
    wild = River(lambda s: 0 * s - 900.0).vectors(rng, 15, shared=0.0)
    assert surface_velocities(SECTION, WET, joined([flow, wild]), 1.0, 3).downstream @ [1, 0] == pytest.approx(1)
    eddy = River(lambda s: np.where(s < 12, -0.1, 0.8)).vectors(rng, 1600, sigma_m_s=0.02, shared=0.0)
    beside = joined([eddy[eddy.position_m[:, 1] < 12], eddy[eddy.position_m[:, 1] > 12][:80]])
    assert np.mean(beside.velocity_m_s[:, 0] < 0) > 0.8
    assert beside.velocity_m_s[:, 0].sum() < 0
    found = surface_velocities(SECTION, WET, beside, 1.0, 3)
    assert found.downstream @ [1, 0] == pytest.approx(1)
    assert found.velocity_m_s[-1] == pytest.approx(0.8, abs=0.1)
