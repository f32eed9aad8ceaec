"""Sections in feet whose header does not say so: said where the velocities contradict them, and not otherwise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from analytic_river import PROFILES, WIDTH_M, WSE_M, River, parabola_m

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.discharge.cross_section import CrossSection, between, referenced
from stab_ros.discharge.measure import measure
from stab_ros.discharge.section_units import in_feet
from stab_ros.discharge.settings import DischargeConfig

RIVER = River(PROFILES["froude"])
FEET = 1 / 0.3048  # in a metre
S = np.concatenate([[-1.0], np.linspace(0, WIDTH_M, 25), [WIDTH_M + 1]])
BED = WSE_M - parabola_m(S)


def by_chainage(places: float = 1.0, heights: float = 1.0) -> CrossSection:
    return between(np.zeros(2), np.array([0.0, WIDTH_M]), S * places, BED * heights)


def surveyed(places: float = 1.0, heights: float = 1.0, shift_m: float = 0.0) -> CrossSection:
    return referenced(np.column_stack([0 * S, S + shift_m]) * places, BED * heights)


def doubts(section: CrossSection, until_m: float = WIDTH_M, speed: Callable[[FloatArray], FloatArray] = RIVER.speed_m_s,
           seed: int = 0, count: int = 1500, from_m: float = 0.0) -> tuple[str, ...]:
    vectors = River(speed).vectors(np.random.default_rng(seed), count, until_m)
    return in_feet(section, vectors[vectors.position_m[:, 1] >= from_m], WSE_M)


@pytest.mark.parametrize(("section", "what"), [
    (by_chainage(FEET), "the places"), (surveyed(FEET), "the places"), (surveyed(1, FEET), "the heights"),
    (surveyed(FEET, FEET), "the places and heights"), (by_chainage(1, FEET), "the heights")])
@pytest.mark.parametrize("profile", PROFILES)
def test_feet_that_the_velocities_contradict_are_said(section: CrossSection, what: str, profile: str) -> None:
    said, = doubts(section, speed=PROFILES[profile])
    assert said.startswith(f"read as feet, {what} of the section fit")
    assert "\n" not in said


@pytest.mark.parametrize("until_m", [WIDTH_M, 14.0, 10.0, 7.0, 6.0, 5.0])
@pytest.mark.parametrize("profile", PROFILES)
def test_metres_are_not_doubted_however_little_of_them_is_seen(profile: str, until_m: float) -> None:
    for section in (by_chainage(), surveyed(), between(np.array([0, WIDTH_M]), np.zeros(2), S, BED[::-1])):
        assert doubts(section, until_m, PROFILES[profile]) == ()


def test_a_strip_in_mid_river_tells_nothing() -> None:
    assert doubts(by_chainage(), 13.0, from_m=7.0) == ()


def test_what_the_velocities_cannot_tell_is_not_said() -> None:
    assert doubts(by_chainage(FEET), count=20) == ()
    assert doubts(by_chainage(FEET), 10.0) == ()
    depths = between(np.zeros(2), np.array([0.0, WIDTH_M]), S[1:-1], -parabola_m(S[1:-1]) * FEET)
    assert in_feet(depths, RIVER.vectors(np.random.default_rng(0)), 0.0) == ()


def test_the_ends_of_a_line_tell_feet_where_velocities_cannot() -> None:
    def of(places: float, line_m: float) -> tuple[str, ...]:
        return doubts(between(np.zeros(2), np.array([0.0, line_m]), S * places, BED), 8.0)

    said, = of(FEET, 22.0)
    assert "reach over 72.18 m, the places between which they lie are 22 m apart" in said
    assert of(FEET, 1.0) == of(FEET, 40.0) == of(1.0, 22.0) == of(1.0, 1.0) == of(1.0, 72.0) == ()


def test_a_bank_that_is_measured_too_tells_no_water() -> None:
    def bank_too(s: FloatArray) -> FloatArray:
        return np.where(s < WIDTH_M, RIVER.speed_m_s(s), 0.0)

    high = S * 3 - WIDTH_M  # a survey of the banks, too, which lie above the water
    section = between(np.array([0.0, -WIDTH_M]), np.zeros(2), high + WIDTH_M, WSE_M - parabola_m(high))
    assert doubts(section, 2 * WIDTH_M, bank_too) == ()


def test_places_far_from_the_map_and_high_elevations_say_why_there_is_no_discharge() -> None:
    vectors = RIVER.vectors(np.random.default_rng(0))
    far = referenced(np.column_stack([0 * S + 40, S - 50]) * FEET, BED)
    away = np.array([40, -50])
    moved = replace(vectors, start_m=vectors.start_m + away, end_m=vectors.end_m + away)
    with pytest.raises(InputError, match=r"no vector lies within .* away; read as feet, the places of the section fit"):
        measure(moved, far, WSE_M, DischargeConfig(draws=100))
    with pytest.raises(InputError, match=r"is dry: .* m; read as feet, the heights of the section fit"):
        measure(vectors, surveyed(1, FEET), WSE_M, DischargeConfig(draws=100))
    found = measure(vectors, by_chainage(FEET), WSE_M, DischargeConfig(draws=100))
    assert sum("read as feet" in warning for warning in found.warnings) == 1
