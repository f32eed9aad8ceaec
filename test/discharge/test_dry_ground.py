"""Water that runs where the section has none, or that stands where it has some: said, and not otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_river import PROFILES, WIDTH_M, WSE_M, River, parabola_m

from stab_ros.core.types import FloatArray
from stab_ros.discharge.cross_section import CrossSection, between, referenced
from stab_ros.discharge.measure import measure
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.velocimetry.speeds import joined
from stab_ros.velocimetry.vectors import Vectors

QUICK = DischargeConfig(draws=100)
RIVER = River(PROFILES["parabolic"])
S = np.arange(-6.0, WIDTH_M + 6.5, 0.5)


def section(shift_m: float = 0.0, islands_m: FloatArray | None = None) -> CrossSection:
    """A survey with high banks; of it, places that stand 1 m above the water."""
    bed = WSE_M - parabola_m(S)
    bed[np.isin(S, [] if islands_m is None else islands_m)] = WSE_M + 1
    return between(np.array([0.0, shift_m]), np.array([0.0, shift_m + 1]), S, bed, 0.0)


def vectors(river: River = RIVER, from_m: float = 0.5, until_m: float = WIDTH_M - 0.5, count: int = 3000) -> Vectors:
    found = river.vectors(np.random.default_rng(1), count, sigma_m_s=0.02, shared=0.0)
    return found[(found.position_m[:, 1] > from_m) & (found.position_m[:, 1] < until_m)]


def bank(place_m: float, v_m_s: float, count: int = 400, sigma_m_s: float = 0.02) -> Vectors:
    """Vectors in a strip of 3 m of a bank, all of one velocity and their noise."""
    found = River(lambda s: 0 * s + v_m_s).vectors(np.random.default_rng(2), count, 3.0, sigma_m_s, 0.0)
    aside = np.array([0.0, place_m])
    return replace(found, start_m=found.start_m + aside, end_m=found.end_m + aside)


def both(one: Vectors, other: Vectors) -> Vectors:
    together = joined([one, other])
    return replace(together, track_id=np.arange(len(together), dtype=np.int64))


def said(found: Discharge, what: str = "calls dry") -> list[str]:
    return [one for one in found.warnings if what in one]


@pytest.mark.parametrize("below_m", [0.4, 0.75, 1.1])
def test_a_level_that_is_too_low_is_said_with_number_and_speed_of_the_vectors(below_m: float) -> None:
    """Counted by hand: beyond the waterline, a fiftieth of the width, and twice the sigma of level and bed."""
    seen, half_m = vectors(), WIDTH_M / 2
    found = measure(seen, section(), WSE_M - below_m, QUICK)
    warning, = said(found)
    shore_m = half_m * np.sqrt(1 - (below_m - 2 * np.hypot(0.02, 0.02)) / 1.5)
    beyond = np.abs(seen.position_m[:, 1] - half_m) - shore_m > 0.02 * found.width_m
    beyond &= np.abs(seen.position_m[:, 0]) <= 0.05 * found.width_m
    assert int(warning.split()[0]) == pytest.approx(int(beyond.sum()), abs=6)  # the shore of straight lines differs
    assert float(warning.split()[3]) == pytest.approx(float(np.median(seen.velocity_m_s[beyond, 0])), abs=0.03)
    assert "the water level is too low, the section lies in the wrong place or ends too early, or a point" in warning


@pytest.mark.parametrize("shift_m", [-3.0, 3.0])
def test_a_section_in_the_wrong_place_is_said(shift_m: float) -> None:
    assert said(measure(vectors(), section(shift_m), WSE_M, QUICK))
    part = S[(S >= 4) & (S <= 22)]
    short = referenced(np.column_stack([0 * part, part]), WSE_M - parabola_m(part - 5))
    assert said(measure(vectors(), short, WSE_M, QUICK))  # which ends on what it takes for the bank


@pytest.mark.parametrize(("shift_m", "doubted"), [(-3.0, True), (0.0, False), (3.0, True)])
def test_a_section_of_depths_whose_ends_are_the_edges_of_the_water(shift_m: float, doubted: bool) -> None:
    """As of a tagline: nothing rises above the water, and the level tells nothing of its place."""
    s = np.linspace(0.0, WIDTH_M, 21)
    line = between(np.array([0.0, shift_m]), np.array([0.0, shift_m + 1]), s, WSE_M - parabola_m(s), 0.0)
    assert bool(said(measure(vectors(), line, WSE_M, QUICK))) is doubted


@pytest.mark.parametrize("islands_m", [[9.5, 10.0], [8.5, 9.0, 9.5, 10.0]])
def test_a_bed_point_that_is_too_high_is_said(islands_m: list[float]) -> None:
    found = measure(vectors(), section(islands_m=np.array(islands_m)), WSE_M, QUICK)
    assert said(found)
    assert found.q_m3_s < RIVER.discharge_m3_s()


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("seed", range(5))
def test_right_sections_are_not_doubted(profile: str, seed: int) -> None:
    """With errors of level, bed and vectors as large as the settings say."""
    river, rng = River(PROFILES[profile]), np.random.default_rng(seed)
    for points, count in ((11, 1000), (25, 200), (101, 3000)):
        found = measure(river.vectors(rng, count), river.section(points, QUICK.depth_sigma_m, rng),
                        WSE_M + rng.normal(0, QUICK.wse_sigma_m), QUICK)
        assert not said(found)
        assert not said(found, "carries")


@pytest.mark.parametrize(("v_m_s", "sigma_m_s", "doubted"), [
    (0.0, 0.02, False), (0.0, 1.0, False), (0.05, 0.02, False), (0.5, 0.02, True), (-0.5, 0.3, True)])
def test_a_bank_that_stands_still_is_none_that_flows(v_m_s: float, sigma_m_s: float, doubted: bool) -> None:
    """Scatter that is larger than any velocity is no flow; a backwater on dry ground is one."""
    seen = both(vectors(), bank(WIDTH_M + 1, v_m_s, sigma_m_s=sigma_m_s))
    assert bool(said(measure(seen, section(), WSE_M, QUICK))) is doubted


@pytest.mark.parametrize("columns", [1, 3])
def test_errors_that_vectors_share_are_no_flow(columns: int) -> None:
    """Of all vectors, or each of a third of them, as of one interval."""
    moving = bank(WIDTH_M + 1, 0.3)
    owner, shared = np.arange(len(moving)) % columns, np.zeros((len(moving), 2, columns))
    shared[np.arange(len(moving)), :, owner] = 0.3
    seen = both(replace(vectors(), shared=np.zeros((len(vectors()), 2, columns))), replace(moving, shared=shared))
    assert said(measure(both(vectors(), moving), section(), WSE_M, QUICK))
    assert not said(measure(seen, section(), WSE_M, QUICK))


def test_some_wild_vectors_on_a_bank_are_no_flow() -> None:
    wild = bank(WIDTH_M + 1, 1.0, 20)
    assert not said(measure(both(vectors(), both(bank(WIDTH_M + 1, 0.0), wild)), section(), WSE_M, QUICK))


def test_a_level_as_uncertain_as_it_is_wrong_is_not_contradicted() -> None:
    unsure = replace(QUICK, wse_sigma_m=0.4)
    assert said(measure(vectors(), section(), WSE_M - 0.4, QUICK))
    assert not said(measure(vectors(), section(), WSE_M - 0.4, unsure))


def test_a_bend_upstream_is_not_taken_for_water_on_the_bank() -> None:
    far = bank(WIDTH_M + 1, 0.5)
    upstream = replace(far, start_m=far.start_m - np.array([5.0, 0]), end_m=far.end_m - np.array([5.0, 0]))
    assert not said(measure(both(vectors(), upstream), section(), WSE_M, QUICK))


def test_water_without_vectors_that_carries_nothing_is_said_with_the_width_that_is_measured() -> None:
    """A section of twice the width: half of it has vectors, and what is measured beside the rest stands still."""
    s = np.arange(-1.0, WIDTH_M + 1.5, 0.5)
    wide = between(np.zeros(2), np.array([0.0, 1.0]), 2 * s, WSE_M - parabola_m(s))
    found = measure(vectors(from_m=0.0, until_m=WIDTH_M), wide, WSE_M, QUICK)
    assert found.shares.measured > 0.99
    assert found.measured_width_share == pytest.approx(0.5, abs=0.05)
    warning, = said(found, "carries")
    assert int(warning.split("%")[0]) == pytest.approx(50, abs=5)


def test_a_level_that_is_far_too_high_is_said() -> None:
    assert said(measure(vectors(), section(), WSE_M + 1.0, QUICK), "carries")


@pytest.mark.parametrize(("from_m", "until_m"), [(0.0, 20.0), (0.0, 13.0), (0.0, 10.0), (5.0, 15.0), (2.0, 18.0)])
@pytest.mark.parametrize("profile", PROFILES)
def test_the_width_that_is_measured(profile: str, from_m: float, until_m: float) -> None:
    found = measure(vectors(River(PROFILES[profile]), from_m, until_m), section(), WSE_M, QUICK)
    assert found.measured_width_share == pytest.approx((until_m - from_m) / WIDTH_M, abs=0.04)
    assert not said(found, "carries")
