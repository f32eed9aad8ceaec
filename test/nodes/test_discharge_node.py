"""The discharge node as users run it: a separate process over DDS, whose discharge is that of the engine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_river import PROFILES, WSE_M, River
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from georeferenced_stream import LATCHED
from live_graph import Graph, values_of
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

from stab_ros.discharge.measure import measure
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.io.cdr import SECOND_NS, Header
from stab_ros.io.velocity_message import velocity_cdr
from stab_ros.velocimetry.speeds import joined
from stab_ros.velocimetry.vectors import Vectors

RIVER = River(PROFILES["froude"])
SETTINGS: dict[str, Any] = {"draws": 100, "window_s": 20.0, "wait_for_subscribers": 1}


def section_file(tmp_path: Path, east_m: float = 0.0) -> str:
    section = RIVER.section()
    rows = [f"{x + east_m!r},{y!r},{z!r}" for (x, y), z in zip(
        section.position_m.tolist(), section.bed_m.tolist(), strict=True)]
    path = tmp_path / "section.csv"
    path.write_text("\n".join(["X,Y,Z", *rows]))
    return str(path)


def interval(second: int, until_m: float = 20.0) -> Vectors:
    return RIVER.vectors(np.random.default_rng(second), 100, until_m, start_s=float(second))


def level_at(second: int, wse_m: float) -> PointStamped:
    level = PointStamped()
    level.header.stamp.sec, level.point.z = second, wse_m
    return level


class Stream:
    """A node under test, velocities for it, and what it says."""

    def __init__(self, graph: Graph, **parameters: object) -> None:
        self.graph = graph
        self.said: list[Any] = graph.listen(DiagnosticArray, "/cam/discharge")
        self.reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
        self.node = graph.start("discharge_node", "/cam", **{**SETTINGS, **parameters})
        self._velocities = graph.speak(PointCloud2, "/cam/velocity")

    def flow(self, seconds: range, until_m: float = 20.0, frame_id: str = "map") -> None:
        for second in seconds:
            header = Header((second + 1) * SECOND_NS, frame_id)
            self._velocities.publish(velocity_cdr(interval(second, until_m), WSE_M, header))

    def discharges(self, count: int) -> list[dict[str, str]]:
        self.graph.until(lambda: len(self.said) >= count, f"{count} discharges")
        return [values_of(one) for one in self.said]

    def report(self, text: str) -> Any:
        """A report on /diagnostics that says so."""
        def found() -> list[Any]:
            return [one for one in self.reports if text in one.status[0].message]

        self.graph.until(found, text)
        return found()[-1]


def test_live_gives_what_the_engine_gives(graph: Graph, tmp_path: Path) -> None:
    stream = Stream(graph, section_file=section_file(tmp_path))
    levels = graph.speak(PointStamped, "/cam/water_level")
    levels.publish(level_at(1, WSE_M))
    graph.until(lambda: any(values_of(one)["water_levels"] == "1" for one in stream.reports), "the level")
    stream.flow(range(32))
    values = stream.discharges(3)
    assert [one.header.stamp.sec for one in stream.said] == [11, 21, 31]
    alone = measure(joined([interval(second) for second in range(11, 31)]), RIVER.section(), WSE_M,
                    DischargeConfig(draws=100))
    offline = {"q_m3_s": alone.q_m3_s, "sigma_m3_s": alone.sigma_m3_s, "low_m3_s": alone.low_m3_s,
               "high_m3_s": alone.high_m3_s, "measured_share": alone.shares.measured, "wse_m": alone.wse_m,
               "extrapolated_share": alone.shares.extrapolated, "iso_sigma": alone.iso_sigma,
               "sigma_water_level_m3_s": alone.sources_m3_s["water level"], "vectors": alone.vectors}
    live = values[-1]
    assert {name: float(live[name]) for name in offline} == pytest.approx(offline, rel=1e-9, abs=1e-9)
    assert float(live["low_m3_s"]) < RIVER.discharge_m3_s() < float(live["high_m3_s"])
    report = stream.report(f"{alone.q_m3_s:.4g} m3/s")
    assert values_of(report)["state"] == "MEASURED"
    assert values_of(report)["sigma_m3_s"] == live["sigma_m3_s"]
    assert stream.node.stop() == 0


def test_a_missing_and_a_stale_level_are_said(graph: Graph, tmp_path: Path) -> None:
    stream = Stream(graph, section_file=section_file(tmp_path), water_level_timeout_s=5.0)
    assert values_of(stream.report("nobody publishes /cam/water_level"))["state"] == "WAITING"
    stream.flow(range(12))
    first, = stream.discharges(1)
    assert first["q_m3_s"] == first["sigma_m3_s"] == ""
    assert "no water level" in first["reason"]
    stream.report("no discharge: no water level has come, and none is given (wse_m); nobody publishes")
    levels = graph.speak(Float64, "/cam/water_level")  # without a stamp: holds from the last velocities on
    stream.report("/cam/water_level has told no level yet")
    levels.publish(Float64(data=WSE_M))
    graph.until(lambda: values_of(stream.reports[-1])["water_levels"] == "1", "the level")
    assert values_of(stream.reports[-1])["water_level_from"] == "water_level"
    stream.flow(range(12, 22))
    second = stream.discharges(2)[-1]
    assert float(second["wse_m"]) == WSE_M
    assert "9 s old" in second["warnings"]
    stream.report("the water level is 9 s old")
    levels.publish(Float64(data=WSE_M + 0.2))  # of which velocimetry knows nothing
    graph.until(lambda: values_of(stream.reports[-1])["water_levels"] == "2", "the next level")
    stream.flow(range(22, 32))
    assert "measured on a water surface at 10 m" in stream.discharges(3)[-1]["warnings"]


@pytest.mark.thorough
def test_a_level_that_is_measured_but_silent_is_said(graph: Graph, tmp_path: Path) -> None:
    """The level of the parameters stands for it, and without a gauge that is as asked."""
    stream = Stream(graph, section_file=section_file(tmp_path), wse_m=WSE_M)
    stream.flow(range(12))
    report = stream.report("m3/s, with 95 %")
    assert (values_of(report)["water_level_from"], report.status[0].level) == ("wse_m", b"\x00")
    graph.speak(Float64, "/cam/water_level")
    assert stream.report("/cam/water_level is published but has told no level yet, wse_m stands for it: 10 m")


@pytest.mark.thorough
def test_a_level_without_a_stamp_holds_when_stamps_begin_anew(graph: Graph, tmp_path: Path) -> None:
    """As where a recording is played in a loop beside a gauge."""
    stream = Stream(graph, section_file=section_file(tmp_path))
    graph.speak(Float64, "/cam/water_level", LATCHED).publish(Float64(data=WSE_M))
    graph.until(lambda: any(values_of(one)["water_levels"] == "1" for one in stream.reports), "the level")
    for _ in range(2):
        stream.flow(range(32))
    assert [one["reason"] for one in stream.discharges(6)] == [""] * 6
    stream.report("stamps of velocities went back by 31.0 s; a discharge needs 10 s of them (every_s)")


@pytest.mark.thorough
def test_a_section_beside_the_water_and_half_a_section_are_said(graph: Graph, tmp_path: Path) -> None:
    stream = Stream(graph, section_file=section_file(tmp_path), wse_m=WSE_M, every_s=5.0, window_s=5.0)
    stream.flow(range(7), until_m=8.0)
    half, = stream.discharges(1)
    assert float(half["extrapolated_share"]) > 0.3
    stream.report("no vectors in the second half of the section")
    stream.flow(range(7, 12), frame_id="camera")
    assert "px/s" in stream.discharges(2)[-1]["reason"]
    assert stream.node.stop() == 0
    beside = Stream(graph, section_file=section_file(tmp_path, 30.0), wse_m=WSE_M, every_s=5.0, window_s=5.0)
    beside.flow(range(7))
    assert "the section must cross the measured water" in beside.discharges(1)[0]["reason"]
    beside.report("no vector lies within")


def test_settings_can_be_changed_and_the_section_cannot(graph: Graph, tmp_path: Path) -> None:
    stream = Stream(graph, section_file=section_file(tmp_path), wse_m=WSE_M)
    stream.flow(range(12))
    first = float(stream.discharges(1)[0]["q_m3_s"])
    assert graph.set_parameter("/cam/discharge_node", "alpha", 0.425) == (True, "")
    assert not graph.set_parameter("/cam/discharge_node", "section_file", "other.csv")[0]
    stream.flow(range(12, 22))
    assert float(stream.discharges(2)[-1]["q_m3_s"]) == pytest.approx(first / 2, rel=0.1)


@pytest.mark.parametrize(("parameters", "text"), [
    ({}, "section_file: is not given"),
    ({"section_file": "nowhere.csv"}, "nowhere.csv"),
])
def test_bad_parameters_end_the_node(graph: Graph, parameters: dict[str, Any], text: str) -> None:
    node = graph.start("discharge_node", "/cam", **parameters)
    assert node.wait() == 2
    assert text in node.log
