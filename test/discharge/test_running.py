"""A discharge every ten seconds, by the stamps."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_river import PROFILES, WSE_M, River

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.discharge.measure import measure
from stab_ros.discharge.running import Reading, RunningDischarge
from stab_ros.discharge.settings import DischargeConfig, RunningConfig
from stab_ros.georeferencing.level_doubts import stale_level
from stab_ros.parameters.node_settings import VelocimetrySettings
from stab_ros.velocimetry.speeds import joined
from stab_ros.velocimetry.vectors import Vectors

CONFIG = DischargeConfig(draws=100)
RIVER = River(PROFILES["froude"])
NS = 1_000_000_000


def interval(second: int) -> Vectors:
    return RIVER.vectors(np.random.default_rng(second), 100, start_s=float(second))


def readings(running: RunningDischarge, seconds: range) -> list[Reading]:
    found = [running.add((second + 1) * NS, interval(second)) for second in seconds]
    return [reading for reading in found if reading is not None]


def test_one_every_ten_seconds_from_the_window() -> None:
    running = RunningDischarge(RIVER.section(), CONFIG, RunningConfig(window_s=20.0), WSE_M)
    found = readings(running, range(45))
    assert [reading.stamp_ns // NS for reading in found] == [11, 21, 31, 41]
    last = found[-1].discharge
    assert last is not None
    alone = measure(joined([interval(second) for second in range(21, 41)]), RIVER.section(), WSE_M, CONFIG)
    assert last.q_m3_s == alone.q_m3_s
    assert last.sigma_m3_s == alone.sigma_m3_s > 0


def test_a_missing_level_gives_a_reason_and_no_number() -> None:
    running = RunningDischarge(RIVER.section(), CONFIG, RunningConfig())
    first, = readings(running, range(12))
    assert first.discharge is None
    assert "no water level" in first.reason
    running.set_level(11 * NS, WSE_M)
    second, = readings(running, range(12, 22))
    assert second.discharge is not None


def test_a_stale_level_is_said() -> None:
    running = RunningDischarge(RIVER.section(), CONFIG, RunningConfig(water_level_timeout_s=15.0))
    running.set_level(0, WSE_M)
    first, second = readings(running, range(22))
    assert not any("old" in warning for warning in first.warnings)
    assert any("21 s old" in warning for warning in second.warnings)
    running.set_level(-5 * NS, 99.0)  # older than the one at hand
    third, = readings(running, range(22, 32))
    assert third.discharge is not None
    assert third.discharge.wse_m == WSE_M


@pytest.mark.parametrize(("age_s", "stale"), [(900, False), (902, True)])
def test_a_level_is_stale_after_as_long_for_velocities_as_for_discharges(age_s: int, stale: bool) -> None:
    assert RunningConfig().water_level_timeout_s == VelocimetrySettings().water_level_timeout_s
    running = RunningDischarge(RIVER.section(), CONFIG, RunningConfig())
    running.set_level(0, WSE_M)
    assert running.level_doubts(age_s * NS) == stale_level(age_s, VelocimetrySettings().water_level_timeout_s)
    assert bool(running.level_doubts(age_s * NS)) is stale


def test_a_window_without_vectors_gives_a_reason() -> None:
    running = RunningDischarge(RIVER.section(), CONFIG, RunningConfig(window_s=10.0), WSE_M)
    readings(running, range(5))
    late = running.add(100 * NS, None)
    assert late is not None
    assert late.discharge is None
    assert "no vector" in late.reason


def test_stamps_that_jump_back_begin_anew() -> None:
    running = RunningDischarge(RIVER.section(), CONFIG, RunningConfig(), WSE_M)
    readings(running, range(100, 112))
    assert running.add(NS, interval(0)) is None
    again, = readings(running, range(1, 12))
    assert again.discharge is not None
    assert again.discharge.start_ns < 12 * NS


def test_misuse() -> None:
    with pytest.raises(ConfigError, match="every_s"):
        RunningConfig(window_s=5.0, every_s=10.0)
    with pytest.raises(InputError, match="finite"):
        RunningDischarge(RIVER.section(), CONFIG, RunningConfig()).set_level(0, float("nan"))
