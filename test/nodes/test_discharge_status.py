"""The report of the discharge node on /diagnostics."""

from __future__ import annotations

import numpy as np
from analytic_river import PROFILES, WSE_M, River

from stab_ros.discharge.measure import measure
from stab_ros.discharge.running import Reading, RunningDischarge
from stab_ros.discharge.settings import DischargeConfig, RunningConfig
from stab_ros.io.cdr import Header
from stab_ros.io.diagnostics_message import ERROR, OK, WARN
from stab_ros.io.discharge_message import discharge_cdr
from stab_ros.nodes.discharge_status import DischargeStatus

SECOND = 10**9


def test_from_waiting_to_stale() -> None:
    status = DischargeStatus(2 * SECOND, ())
    status.waiting_for = "velocities on /a"
    report = status.report(0)
    assert (report.level, report.message, report.values["state"]) == (WARN, "waiting for velocities on /a", "WAITING")
    status.on_velocity(5 * SECOND, 7, SECOND)
    status.on_level(3 * SECOND)
    report = status.report(SECOND)
    assert (report.level, report.values["state"], report.values["vectors_in"]) == (OK, "GATHERING", "7")
    assert report.values["water_level_age_s"] == "2.0"
    river = River(PROFILES["froude"])
    found = measure(river.vectors(np.random.default_rng(1)), river.section(), WSE_M, DischargeConfig(draws=100))
    status.on_reading(Reading(5 * SECOND, found))
    report = status.report(SECOND)
    assert (report.level, report.values["state"], report.values["discharges"]) == (OK, "MEASURED", "1")
    assert float(report.values["q_m3_s"]) == found.q_m3_s
    assert float(report.values["sigma_m3_s"]) == found.sigma_m3_s
    assert float(report.values["measured_width_share"]) == found.measured_width_share
    assert "vectors over 100% of the width" in report.message
    report = status.report(4 * SECOND)
    assert (report.level, report.values["state"]) == (ERROR, "STALE")


def test_water_on_dry_ground_is_said_by_message_and_diagnostics() -> None:
    river = River(PROFILES["froude"])
    running = RunningDischarge(river.section(), DischargeConfig(draws=100), RunningConfig(every_s=1.0), WSE_M - 0.5)
    vectors = river.vectors(np.random.default_rng(1))
    readings = [running.add(second * SECOND, vectors) for second in (1, 2)]
    reading = readings[-1]
    assert reading is not None
    status = DischargeStatus(9 * SECOND, ())
    status.on_velocity(2 * SECOND, len(vectors), 0)
    status.on_reading(reading)
    report = status.report(0)
    assert "on ground that the section calls dry" in report.message
    assert (report.level, report.values["state"]) == (WARN, "MEASURED")
    assert b"on ground that the section calls dry" in discharge_cdr(reading, Header(2 * SECOND, "map"))


def test_what_is_inactive_has_no_doubts_but_those_of_its_section() -> None:
    status = DischargeStatus(2 * SECOND, ("the section is short",))
    status.on_velocity(SECOND, 0, 0)
    status.suspend()
    status.level_missing = "nobody publishes water_level"
    report = status.report(9 * SECOND).while_inactive()
    assert (report.level, report.values["state"]) == (WARN, "INACTIVE")
    assert report.message.split("; ") == ["takes no velocities", "the section is short"]
    report = status.report(9 * SECOND)
    assert (report.level, report.values["state"]) == (WARN, "WAITING")


def test_no_number_without_a_discharge() -> None:
    status = DischargeStatus(2 * SECOND, ("the section is short",))
    status.on_velocity(SECOND, 0, 0)
    status.level_doubts = ("no water level has come",)
    report = status.report(0)
    assert report.message.split("; ") == ["gathering velocities", "the section is short", "no water level has come"]
    status.on_reading(Reading(SECOND, None, "there is no vector", ("the water level is 70 s old",)))
    status.warn("unusable", "refused a message")
    report = status.report(0)
    assert (report.level, report.values["state"]) == (WARN, "UNMEASURED")
    assert report.message.split("; ") == ["no discharge: there is no vector", "the section is short",
                                          "the water level is 70 s old", "refused a message"]
    assert report.values["q_m3_s"] == report.values["sigma_m3_s"] == report.values["measured_share"] == ""
    assert "refused" not in status.report(0).message
