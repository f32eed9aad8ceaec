"""Discharge of analytic rivers: its accuracy, its interval, and what is said where something is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_river import ALPHA, PROFILES, WIDTH_M, WSE_M, River, parabola_m

from stab_ros.core.errors import InputError
from stab_ros.discharge.cross_section import CrossSection, between
from stab_ros.discharge.doubts import looks_like_depths
from stab_ros.discharge.measure import measure
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.velocimetry.speeds import no_vectors

QUICK = DischargeConfig(draws=200)
RIVER = River(PROFILES["froude"])


def of(river: River = RIVER, config: DischargeConfig = QUICK, until_m: float = WIDTH_M,
       section: CrossSection | None = None, wse_m: float = WSE_M) -> Discharge:
    vectors = river.vectors(np.random.default_rng(1), 3000, until_m, 0.02, 0.0)
    return measure(vectors, section or river.section(), wse_m, config)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("integration", ["mid_section", "mean_section"])
def test_within_two_percent_with_full_coverage(profile: str, integration: str) -> None:
    river = River(PROFILES[profile])
    found = of(river, replace(QUICK, integration=integration))
    assert found.q_m3_s == pytest.approx(river.discharge_m3_s(), rel=0.02)
    assert found.shares.measured == pytest.approx(1)
    assert found.width_m == pytest.approx(WIDTH_M, rel=0.01)


@pytest.mark.parametrize("profile", PROFILES)
def test_within_five_percent_with_a_third_extrapolated(profile: str) -> None:
    river = River(PROFILES[profile])
    found = of(river, until_m=WIDTH_M * 2 / 3)
    assert found.q_m3_s == pytest.approx(river.discharge_m3_s(), rel=0.05)
    assert 0.15 < found.shares.extrapolated < 0.35
    assert found.low_m3_s < river.discharge_m3_s() < found.high_m3_s


def inside(profile: str, until_m: float, seed: int) -> bool:
    """Whether the truth lies in the interval, with alpha, level, bed, scale and vectors drawn as the settings say."""
    river, rng = River(PROFILES[profile]), np.random.default_rng(seed)
    alpha = rng.normal(ALPHA, QUICK.alpha_sigma)
    section = river.section(25, QUICK.depth_sigma_m, rng)
    vectors = river.vectors(rng, 1000, until_m)
    found = measure(vectors, section, WSE_M + rng.normal(0, QUICK.wse_sigma_m), replace(QUICK, seed=seed))
    return found.low_m3_s <= river.discharge_m3_s(alpha) <= found.high_m3_s


@pytest.mark.thorough
@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("part", [1.0, 2 / 3])
def test_the_truth_lies_in_the_interval_in_90_to_98_percent_of_draws(profile: str, part: float) -> None:
    share = np.mean([inside(profile, part * WIDTH_M, seed) for seed in range(1000, 1200)])
    assert 0.90 <= share <= 0.98


def test_the_truth_lies_in_the_interval_of_most_of_20_draws() -> None:
    assert sum(inside("froude", WIDTH_M, seed) for seed in range(20)) >= 17


def test_sources_add_up_and_shared_errors_do_not_average_out() -> None:
    vectors = RIVER.vectors(np.random.default_rng(0), 3000, shared=0.03)
    found = measure(vectors, RIVER.section(), WSE_M, DischargeConfig(draws=2000))
    by_squares = np.sqrt(sum(sigma**2 for sigma in found.sources_m3_s.values()))
    assert found.sigma_m3_s == pytest.approx(by_squares, rel=0.1)
    assert found.sources_m3_s["shared"] == pytest.approx(0.03 * found.q_m3_s, rel=0.1)
    assert found.sources_m3_s["alpha"] == pytest.approx(0.04 / 0.85 * found.q_m3_s, rel=0.1)
    assert found.sources_m3_s["vectors"] < 0.01 * found.q_m3_s


def test_iso_and_ive_are_of_the_same_order_as_monte_carlo() -> None:
    found = of()
    relative = found.sigma_m3_s / found.q_m3_s
    assert relative < found.iso_sigma < 2 * relative
    assert 0.5 * relative < found.ive_sigma < 2 * relative


def test_the_same_twice() -> None:
    assert np.array_equal(of().drawn_m3_s, of().drawn_m3_s)


def test_the_direction_of_the_survey_and_of_the_flow_do_not_matter() -> None:
    forth = of().q_m3_s
    s = np.linspace(-1, WIDTH_M + 1, 45)
    back = between(np.array([0.0, WIDTH_M]), np.zeros(2), s, WSE_M - parabola_m(WIDTH_M - s))
    assert of(section=back).q_m3_s == pytest.approx(forth, rel=0.02)
    assert of(River(lambda s: -PROFILES["froude"](s))).q_m3_s == pytest.approx(forth, rel=0.01)


def test_water_that_crosses_at_an_angle_counts_by_its_component_and_is_mentioned() -> None:
    vectors = RIVER.vectors(np.random.default_rng(1), 3000, sigma_m_s=0.02, shared=0.0, turn_rad=np.radians(40))
    found = measure(vectors, RIVER.section(), WSE_M, QUICK)
    assert found.q_m3_s == pytest.approx(RIVER.discharge_m3_s() * np.cos(np.radians(40)), rel=0.02)
    assert any("40 degrees off" in warning for warning in found.warnings)


def test_evenly_spaced_verticals_in_place_of_the_survey() -> None:
    sparse = RIVER.section(61)
    found = of(section=sparse, config=replace(QUICK, verticals=30))
    assert int(found.verticals.measured.sum()) == 30
    assert found.q_m3_s == pytest.approx(RIVER.discharge_m3_s(), rel=0.02)


def test_few_verticals_cost_certainty_and_are_said() -> None:
    found = of(section=RIVER.section(6))
    assert found.sources_m3_s["verticals"] == pytest.approx(0.075 * found.q_m3_s, rel=0.2)
    assert any("only 4 verticals" in warning for warning in found.warnings)
    assert found.low_m3_s < RIVER.discharge_m3_s() < found.high_m3_s


def test_one_vertical_is_one_vertical() -> None:
    found = of(section=RIVER.section(3), until_m=11.0)
    assert "only 1 vertical is measured, there should be 7 or more" in found.warnings


def test_still_water_is_measured_to_flow_nowhere() -> None:
    found = of(River(lambda s: 0 * s))
    assert abs(found.q_m3_s) < 0.01 * RIVER.discharge_m3_s()
    assert found.shares.measured == pytest.approx(1)
    assert found.low_m3_s < 0 < found.high_m3_s


def test_a_wall_with_its_foot_and_its_top_in_one_place_counts_once_for_the_search_distance() -> None:
    s = np.concatenate([[-1.0, 0.0], np.arange(0.0, 20.5, 1.0), [20.0, 21.0]])
    bed = np.concatenate([[WSE_M + 1, WSE_M + 1], np.full(21, WSE_M - 1.5), [WSE_M + 1, WSE_M + 1]])
    river = River(lambda s: 0 * s + 1.0, lambda s: 0 * s + 1.5)
    stepped = between(np.zeros(2), np.array([0.0, 1.0]), np.insert(s, 5, s[5]), np.insert(bed, 5, bed[5] + 0.5))
    plain, doubled = of(river, section=between(np.zeros(2), np.array([0.0, 1.0]), s, bed)), of(river, section=stepped)
    assert doubled.search_m == plain.search_m == pytest.approx(20 / 42)
    assert plain.q_m3_s == pytest.approx(river.discharge_m3_s(), rel=0.02)


def test_an_island_makes_two_channels() -> None:
    def depth(s: np.ndarray) -> np.ndarray:
        return np.asarray(parabola_m(s) - 2.0 * np.exp(-(((s - 8) / 1.5) ** 2)))

    river = River(lambda s: 0.8 * np.sqrt(np.maximum(depth(s), 0)), depth)
    found = of(river, section=river.section(61))
    assert found.q_m3_s == pytest.approx(river.discharge_m3_s(), rel=0.02)
    assert found.verticals.channel.max() == 1
    assert found.width_m < WIDTH_M - 1
    one_side = of(river, section=river.section(61), until_m=6.0)
    assert any("no vectors in channel 2 of 2" in warning for warning in one_side.warnings)
    assert one_side.q_m3_s == pytest.approx(river.discharge_m3_s(), rel=0.05)


def test_half_a_section_without_vectors_is_said() -> None:
    found = of(until_m=WIDTH_M / 2 - 1)
    assert any("no vectors in the second half" in warning for warning in found.warnings)
    assert any("extrapolated beyond" in warning for warning in found.warnings)
    assert found.sigma_m3_s > of().sigma_m3_s


def test_a_section_that_ends_under_water_is_said() -> None:
    s = np.linspace(4, 16, 20)
    section = between(np.array([0.0, 4.0]), np.array([0.0, 5.0]), s, WSE_M - parabola_m(s), 4.0)
    assert sum("under water" in warning for warning in of(section=section).warnings) == 2


def test_a_dry_section_makes_no_discharge() -> None:
    with pytest.raises(InputError, match="the section is dry"):
        of(wse_m=2.0)


def test_a_section_beside_the_water_makes_no_discharge() -> None:
    s = np.arange(-1.0, 22)
    beside = between(np.array([500.0, 0]), np.array([500.0, 1]), s, WSE_M - parabola_m(s))
    with pytest.raises(InputError, match="the nearest is 49"):
        of(section=beside)


def test_too_few_or_no_vectors_and_pixels_make_no_discharge() -> None:
    with pytest.raises(InputError, match="at most"):
        of(config=replace(QUICK, min_vectors=5000))
    with pytest.raises(InputError, match="there is no vector"):
        measure(no_vectors(), RIVER.section(), WSE_M, QUICK)
    with pytest.raises(InputError, match="px/s"):
        measure(no_vectors("px"), RIVER.section(), WSE_M, QUICK)


@pytest.mark.parametrize(("heights_m", "alike"), [
    ([0, 0.5, 1.4, 0.3, 0], True), ([-0.05, 0.5, 1.4, 0.3, -0.1], True),  # points above the water at the shores
    ([1.0, -0.5, -1.4, -0.3, 0.8], False), ([0.1, -1.0, -2.0, 0.05], False), ([0, -1.0, -2.0, 0], False)])
def test_heights_that_look_like_depths(heights_m: list[float], alike: bool) -> None:
    assert looks_like_depths(np.array(heights_m)) is alike


def test_depths_taken_for_elevations_are_doubted() -> None:
    section = RIVER.section()
    as_depths = between(np.zeros(2), np.array([0.0, 1]), section.chainage_m[1:-1], WSE_M - section.bed_m[1:-1])
    assert any("must be named depth" in warning for warning in of(section=as_depths, wse_m=WSE_M).warnings)
    assert not any("must be named depth" in warning for warning in of().warnings)
