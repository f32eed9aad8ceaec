"""Filters: each drops what it is for, keeps the rest, and is counted under its name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stab_ros.core.errors import ConfigError
from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.filters import FILTERS, Candidates, filtered
from stab_ros.velocimetry.local_median import fits_neighbours
from stab_ros.velocimetry.settings import PRESETS, VelocityConfig
from stab_ros.velocimetry.vectors import Vectors

OFF: dict[str, Any] = {"steadiness": 0.0, "local_median": 0.0, "min_track": 0.01}


def candidates(velocity: FloatArray, dt_s: float = 1.0, sigma: float = 0.01, parts: FloatArray | None = None,
               start: FloatArray | None = None) -> Candidates:
    n = len(velocity)
    begin = np.stack([np.arange(n) * 1.0, np.zeros(n)], axis=1) if start is None else start
    end_ns = np.full(n, round(dt_s * 1e9))
    vectors = Vectors(begin, begin + velocity * dt_s, np.zeros(n, np.int64), end_ns,
                      np.tile(sigma**2 * np.eye(2), (n, 1, 1)), np.zeros((n, 2, 0)), np.arange(n))
    return Candidates(vectors, np.repeat(velocity[:, None], 3, axis=1) if parts is None else parts)


@pytest.mark.parametrize(("name", "parameters"), [
    ("min_speed", {"min_speed": 1.5}), ("max_speed", {"max_speed": 0.5}),
    ("direction", {"direction_deg": 180.0, "direction_tolerance_deg": 45.0}), ("max_sigma", {"max_sigma": 0.005}),
    ("min_track", {"min_track": 1.0, "extract_s": 2.0}),
])
def test_a_filter_drops_and_is_counted(name: str, parameters: dict[str, float]) -> None:
    found = filtered(candidates(np.array([[1.0, 0.0], [0.9, 0.1]])), VelocityConfig(**{**OFF, **parameters}))
    assert len(found.vectors) == 0
    assert {key: n for key, n in found.dropped.items() if n} == {name: 2}
    assert set(found.dropped) == set(FILTERS)


def test_directions_wrap_around() -> None:
    config = VelocityConfig(**{**OFF, "direction_deg": 175.0, "direction_tolerance_deg": 20.0})
    found = filtered(candidates(np.array([[-1.0, -0.1], [-1.0, 0.1], [1.0, 0.0]])), config)
    assert list(found.vectors.track_id) == [0, 1]


def test_a_track_that_jumps_is_not_steady() -> None:
    velocity = np.array([[1.0, 0.0], [1.0, 0.0]])
    parts = np.array([[[1, 0], [1.1, 0], [0.9, 0]], [[0, 0], [3, 0], [0, 0]]], float)
    found = filtered(candidates(velocity, parts=parts), VelocityConfig(**{**OFF, "steadiness": 0.5}))
    assert list(found.vectors.track_id) == [0]


def test_the_local_median_finds_the_outlier_in_a_sheared_flow() -> None:
    rng = np.random.default_rng(3)
    at = rng.uniform(0, 10, (200, 2))
    velocity = np.stack([0.3 * at[:, 1], np.zeros(200)], axis=1) + rng.normal(0, 0.01, (200, 2))
    velocity[50] += [0, 1.5]
    fits = fits_neighbours(at, velocity, np.full(200, 0.01), 3.0, 0.02)
    assert not fits[50]
    assert fits.sum() >= 190


def test_few_vectors_have_no_neighbours_to_ask() -> None:
    assert fits_neighbours(np.zeros((4, 2)), np.eye(4, 2), np.zeros(4), 3.0, 0.0).all()


def test_the_preset_of_the_paper_filters_nothing() -> None:
    config = VelocityConfig(**dict[str, Any](PRESETS["klt_iv"]))
    velocity = np.random.default_rng(1).normal(0, 5, (30, 2))
    assert len(filtered(candidates(velocity), config).vectors) == 30


@pytest.mark.parametrize("wrong", [{"block_px": 30}, {"min_speed": 2.0, "max_speed": 1.0}, {"follow": "akaze"},
                                   {"extract_s": 0.0}])
def test_settings_that_contradict_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        VelocityConfig(**wrong)
