"""Velocity fields, the paths in them, and discharges, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.synthetic.advection import Paths, advected
from stab_ros.synthetic.channel import Channel, EllipticIsland
from stab_ros.synthetic.cross_section import Bed, CrossSection, alpha_of_power_law
from stab_ros.synthetic.river import SCENES, preset
from stab_ros.synthetic.river_flows import FLOWS, bed_of, flow_of, section_of
from stab_ros.synthetic.velocity_fields import (
    ChannelFlow,
    Eddy,
    Profile,
    Sum,
    Surge,
    Uniform,
    Unsteady,
    VelocityField,
)

BENT = Channel(half_width_m=5.0, middle_m=1.0, bend_m=0.8, bend_per_m=0.2, bend_phase=0.4)
STRAIGHT = Channel(half_width_m=5.0)


def scattered(n: int, seed: int = 1, within_m: float = 4.0) -> FloatArray:
    return np.random.default_rng(seed).uniform(-within_m, within_m, (n, 2))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("kind", FLOWS)
def test_flows_have_no_sources(name: str, kind: str) -> None:
    field, channel = flow_of(preset(name), kind), Channel.of(preset(name))
    across = np.random.default_rng(2).uniform(-0.95, 0.95, 400)
    east = np.random.default_rng(3).uniform(-0.4, 0.4, 400) * preset(name).ground_m[0]
    points = np.column_stack([east, channel.centre_north_m(east) + across * channel.half_width_m])
    d = 1e-4 * channel.half_width_m
    du, dv = ((field.velocity_m_s(points + step, 1.3) - field.velocity_m_s(points - step, 1.3))[:, k] / (2 * d)
              for k, step in enumerate(np.eye(2) * d))
    on_shore = np.zeros(len(points), bool)
    for island in channel.islands:
        on_shore |= np.abs(island.openness(points)) < 0.01  # the velocity jumps where the water ends
    assert np.abs(du + dv)[~on_shore].max() < 1e-5 * np.abs(du).max()


@pytest.mark.parametrize(("name", "speed"), [("kolubara", 0.12), ("alpine", 2.0), ("basento", 0.4)])
def test_scenes_flow_as_fast_as_in_the_paper(name: str, speed: float) -> None:
    channel, (width, _) = Channel.of(preset(name)), preset(name).ground_m
    east, across = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.5, 0.5, 161) * width, np.linspace(-1, 1, 161)))
    points = np.column_stack([east, channel.centre_north_m(east) + across * channel.half_width_m])
    assert np.hypot(*flow_of(preset(name)).velocity_m_s(points, 0.0).T).max() == pytest.approx(speed, rel=0.03)


def test_a_path_in_a_channel_keeps_its_place_between_the_banks() -> None:
    field, start = ChannelFlow(BENT, 1.5, Profile(exponent=3.0, skew=-0.3)), scattered(200, within_m=3.0)
    end, across = advected(field, start, 0.0, 6.0), BENT.across(start)
    east = start[:, 0] + 6 * 1.5 * (1 - np.abs(across) ** 3) * (1 - 0.3 * across)
    north = BENT.centre_north_m(east) + across * 5.0
    np.testing.assert_allclose(end, np.column_stack([east, north]), atol=1e-8)


def test_water_in_an_eddy_goes_round() -> None:
    eddy, start = Eddy((1.0, -2.0), 1.5, 0.7), scattered(100)
    centre = np.array([1.0, -2.0])
    off = start - centre
    turn = 0.7 * np.exp((1 - np.sum(off**2, axis=1) / 1.5**2) / 2) / 1.5 * 4.0
    turned = np.column_stack([off[:, 0] * np.cos(turn) - off[:, 1] * np.sin(turn),
                              off[:, 0] * np.sin(turn) + off[:, 1] * np.cos(turn)])
    np.testing.assert_allclose(advected(eddy, start, 1.0, 5.0), turned + centre, atol=1e-8)


def test_an_eddy_is_fastest_at_its_radius() -> None:
    speeds = np.hypot(*Eddy((0, 0), 2.0, 0.5).velocity_m_s(np.array([[1.9, 0], [2.0, 0], [2.1, 0]]), 0.0).T)
    assert speeds.argmax() == 1
    assert speeds.max() == pytest.approx(0.5)


def test_pulses_and_surges_carry_as_far_as_their_integral() -> None:
    field = Unsteady(Uniform(0.8, -0.2), share=0.3, period_s=4.0, surges=(Surge(2.0, 0.3, 0.5),))
    pulse = 0.3 * 4.0 / (2 * math.pi) * (1 - math.cos(2 * math.pi * 5.0 / 4.0))
    surge = 0.5 * 0.3 * math.sqrt(math.pi / 2) * (math.erf(3 / 0.3 / math.sqrt(2)) + math.erf(2 / 0.3 / math.sqrt(2)))
    moved = advected(field, scattered(3), 0.0, 5.0) - scattered(3)
    np.testing.assert_allclose(moved, np.tile([0.8, -0.2], (3, 1)) * (5.0 + pulse + surge), atol=1e-7)


def test_water_runs_round_an_island() -> None:
    island = EllipticIsland((0.0, 0.5), (2.0, 1.0))
    field = ChannelFlow(Channel(5.0, islands=(island,)), 1.0, Profile(exponent=8.0))
    angle = np.linspace(0, 2 * math.pi, 50)
    shore = np.array(island.centre_m) + 1.0005 * np.column_stack([2 * np.cos(angle), np.sin(angle)])
    normal = np.column_stack([np.cos(angle) / 2, np.sin(angle)])
    across = np.sum(field.velocity_m_s(shore, 0.0) * normal, axis=1) / np.linalg.norm(normal, axis=1)
    assert np.abs(across).max() < 0.005
    assert (field.velocity_m_s(np.array([[0.3, 0.6]]), 0.0) == 0).all()
    assert field.velocity_m_s(np.array([[0.0, 1.501]]), 0.0)[0, 0] == pytest.approx(2.0, abs=0.02)


def test_paths_do_not_depend_on_what_was_asked_before() -> None:
    field: VelocityField = Sum((ChannelFlow(BENT, 1.5), Eddy((0, 0), 1.0, 1.0)))
    a, b = (Paths(field, scattered(50), -0.3, 0.05) for _ in range(2))
    far, _, near = a.at(1.934), a.at(2.7), a.at(0.111)
    np.testing.assert_array_equal(b.at(0.111), near)
    np.testing.assert_array_equal(b.at(1.934), far)
    np.testing.assert_allclose(far, advected(field, scattered(50), -0.3, 1.934), atol=2e-5)


@pytest.mark.parametrize("channel", [STRAIGHT, BENT])
def test_discharge_of_a_parabolic_channel(channel: Channel) -> None:
    section = CrossSection.at(Bed(channel, 1.2), 2.0, beyond_m=0.7)
    closed = 0.85 * 0.6 * 1.2 * 5.0 * 16 / 15  # alpha U H w times the integral of (1 - e^2)^2
    assert section.discharge_m3_s(ChannelFlow(channel, 0.6)) == pytest.approx(closed, rel=1e-6)
    assert section.area_m2() == pytest.approx(1.2 * 5.0 * 4 / 3, rel=1e-6)


def test_discharge_through_an_oblique_section_of_a_uniform_flow() -> None:
    section = CrossSection((-3.0, 6.0), (4.0, -6.0), Bed(STRAIGHT, 1.2))
    closed = alpha_of_power_law(6.0) * 0.6 * 1.2 * 10.0 * 2 / 3  # what flows along the channel crosses any section
    assert section.discharge_m3_s(Uniform(0.6), alpha=6 / 7) == pytest.approx(closed, rel=1e-6)
    back = CrossSection((4.0, -6.0), (-3.0, 6.0), Bed(STRAIGHT, 1.2))
    assert back.discharge_m3_s(Uniform(0.6), alpha=6 / 7) == pytest.approx(-closed, rel=1e-6)


def test_mean_discharge_of_a_pulse_is_that_of_the_steady_flow() -> None:
    section, steady = CrossSection.at(Bed(STRAIGHT, 1.2), 0.0), ChannelFlow(STRAIGHT, 0.6)
    pulsing = Unsteady(steady, 0.4, 3.0)
    assert section.discharge_m3_s(pulsing, 0.75) == pytest.approx(1.4 * section.discharge_m3_s(steady), rel=1e-9)
    assert section.mean_discharge_m3_s(pulsing, 1.0, 4.0) == pytest.approx(section.discharge_m3_s(steady), rel=1e-6)


def test_a_survey_lies_on_the_section() -> None:
    section = section_of(preset("alpine"))
    exact, rough = section.surveyed(25), section.surveyed(25, seed=3, noise_m=0.02)
    np.testing.assert_allclose(exact.depth_m, section.bed.depths_m(exact.points_m), atol=1e-12)
    np.testing.assert_allclose(exact.bed_m, section.bed.wse_m - exact.depth_m, atol=1e-12)
    assert (np.diff(rough.chainage_m) > 0).all()
    assert rough.chainage_m[[0, -1]] == pytest.approx([0, section.length_m])
    assert np.std(rough.bed_m + section.bed.depths_m(rough.points_m)) == pytest.approx(0.02, rel=0.5)


def test_the_section_of_alpine_crosses_an_island() -> None:
    wet = section_of(preset("alpine")).surveyed(200).depth_m > 0
    assert np.abs(np.diff(wet.astype(int))).sum() == 4


def test_depth_follows_the_shores_of_a_scene() -> None:
    bed, (width, height) = bed_of(preset("kolubara")), preset("kolubara").ground_m
    assert bed.depths_m(np.array([[0.1 * width, 0.45 * height]]))[0] == 0
    assert bed.depths_m(np.array([[0.0, 0.0]]))[0] == pytest.approx(1.4, rel=0.1)


@pytest.mark.parametrize("wrong", [
    lambda: Channel(0.0), lambda: EllipticIsland((0, 0), (1.0, 0.0)), lambda: Profile(exponent=0.5),
    lambda: Profile(skew=1.2), lambda: Eddy((0, 0), 0.0, 1.0), lambda: Bed(STRAIGHT, 0.0),
    lambda: CrossSection((1, 1), (1, 1), Bed(STRAIGHT, 1.0)), lambda: flow_of(preset("alpine"), "laminar"),
    lambda: section_of(preset("alpine")).surveyed(1),
])
def test_what_is_no_river_is_refused(wrong: Callable[[], object]) -> None:
    with pytest.raises(InputError, match="must"):
        wrong()
