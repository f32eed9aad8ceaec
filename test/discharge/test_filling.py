"""Each way of filling is exact for the profile that it assumes."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.discharge.filling import FILLINGS
from stab_ros.discharge.filling_kriged import kriging_sigma_m_s
from stab_ros.discharge.measured import Measured
from stab_ros.discharge.wetted import channels

S = np.concatenate([[-1.0], np.linspace(0, 10, 21), [11.0]])
DEPTH = np.interp(S, [-1, 0, 3, 8, 10, 11], [-1, 0, 2, 1, 0, -1])
KNOWN = (S > 1) & (S < 6) & ~((S > 3) & (S < 4))


def filled(name: str, velocity: FloatArray, known: BoolArray = KNOWN, depth: FloatArray = DEPTH) -> FloatArray:
    measured = Measured(S, depth, channels(depth), known)
    return np.asarray(FILLINGS[name](measured, depth[None], np.where(known, velocity, 99.0)[None])[0])


PROFILES = {
    "froude_linear": 0.5 * np.sqrt(np.maximum(DEPTH, 0)) * (1 + 0.05 * (S - 3)),
    "kriging": 0.7 * np.sqrt(np.maximum(DEPTH, 0)),
    "froude": 0.7 * np.sqrt(np.maximum(DEPTH, 0)), "klt_iv": 0.4 * np.maximum(DEPTH, 0),
    "quadratic": np.maximum(0.08 * S * (10 - S), 0), "cubic": np.maximum(0.01 * S * (10 - S) * (S + 3), 0)}


@pytest.mark.parametrize("name", FILLINGS)
def test_exact_for_its_own_profile(name: str) -> None:
    wet = DEPTH > 0
    assert filled(name, PROFILES[name])[wet] == pytest.approx(PROFILES[name][wet], abs=1e-9)


@pytest.mark.parametrize("name", FILLINGS)
def test_measured_verticals_stay_as_they_are(name: str) -> None:
    velocity = np.random.default_rng(0).uniform(0.5, 1, len(S))
    assert np.array_equal(filled(name, velocity)[KNOWN], velocity[KNOWN])


def test_a_polynomial_does_not_run_away() -> None:
    known = (S > 4) & (S < 6)
    steep = np.where(known, 1 + 3 * (S - 4), 0.0)
    for name in ("quadratic", "cubic"):
        assert 0 <= filled(name, steep, known).min() <= filled(name, steep, known).max() <= 1.2 * steep.max()


def test_eddies_that_flow_back_are_filled_backwards() -> None:
    assert (filled("froude", -PROFILES["froude"])[DEPTH > 0] < 0).all()


def test_a_channel_without_vectors_takes_the_froude_number_of_the_other() -> None:
    island = np.where(np.abs(S - 6) < 0.8, -0.5, DEPTH)
    velocity = 0.7 * np.sqrt(np.maximum(island, 0))
    assert filled("froude", velocity, KNOWN & (S < 5), island) == pytest.approx(velocity)


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0])
def test_kriging_tells_how_the_velocity_goes_with_the_depth(power: float) -> None:
    noise = np.random.default_rng(0).normal(0, 0.003, len(S))
    true = 0.5 * np.maximum(DEPTH, 0.0) ** power
    wet = DEPTH > 0
    assert filled("kriging", true + noise)[wet] == pytest.approx(true[wet], abs=0.05)


def test_kriging_goes_on_as_measured() -> None:
    beside_an_island = np.where(DEPTH > 0, 0.4 + 0.1 * S, 0.0)  # fastest where it is shallow
    assert filled("kriging", beside_an_island)[S == 6.5] == pytest.approx(1.05, abs=0.05)
    assert filled("froude", beside_an_island)[S == 6.5] < 0.95


@pytest.mark.parametrize("sign", [1, -1])
def test_kriging_turns_no_flow_round_and_does_not_run_away(sign: int) -> None:
    for steep in (np.maximum(S - 4, 0), np.maximum(6 - S, 0)):
        found = sign * filled("kriging", sign * steep)[DEPTH > 0]
        assert found.min() >= 0
        assert found.max() <= 1.2 * steep[KNOWN].max()


def test_sigma_of_kriging_holds_the_difference_of_profiles() -> None:
    measured = Measured(S, DEPTH, channels(DEPTH), KNOWN)
    steady, doubtful = (kriging_sigma_m_s(measured, np.where(KNOWN, velocity, 99.0))
                        for velocity in (PROFILES["froude"], 0.7 + 0.2 * np.sin(3 * S)))
    assert (steady[KNOWN] == 0).all()
    assert steady.max() < 1e-3
    assert (doubtful[~KNOWN & (DEPTH > 0)] > 0.02).all()
