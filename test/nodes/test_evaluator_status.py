"""The evaluator on /diagnostics: counts, statistics over a window, and the problems of each frame."""

from __future__ import annotations

import pytest

from stab_ros.evaluation.evaluator import Arrival
from stab_ros.evaluation.findings import Finding, Level
from stab_ros.evaluation.frame_metrics import UNITS, FrameMetrics, Outcome
from stab_ros.nodes.evaluator_status import EvaluatorStatus

SECOND_NS = 10**9
INTERVAL_NS = 40_000_000


class StatusFeed:
    """Feeds a status with frames, 40 ms apart on one clock."""

    def __init__(self, window_s: int = 60, alarm_s: int = 3, stale_s: int = 1) -> None:
        self.status = EvaluatorStatus(window_s * SECOND_NS, alarm_s * SECOND_NS, stale_s * SECOND_NS)
        self.now_ns = 5 * SECOND_NS
        self.number = -1

    def frame(self, *found: Finding, outcome: Outcome = Outcome.MEASURED, **values: float) -> None:
        self.number += 1
        self.now_ns += INTERVAL_NS
        self.status.on_alive(self.now_ns)
        self.status.on_frame(self.arrival())
        metrics = FrameMetrics(self.number, self.number * INTERVAL_NS, outcome, values)
        self.status.on_metrics(metrics, found, self.now_ns)

    def arrival(self) -> Arrival:
        return Arrival(self.number, self.number * INTERVAL_NS, None, False, None)

    def says(self, delay_ns: int = 0) -> tuple[Level, str, dict[str, str]]:
        report = self.status.report(self.now_ns, delay_ns, self.now_ns)
        assert report.level == self.status.level(self.now_ns, delay_ns, self.now_ns)
        return Level(report.level), report.message, dict(report.values)


def test_before_the_first_image_it_waits_and_says_for_what() -> None:
    stream = StatusFeed()
    stream.status.waiting_for = "images on /cam/image_stabilized, nobody publishes it"
    level, message, values = stream.says()
    assert (level, values["state"]) == (Level.WARN, "WAITING")
    assert message == "waiting for images on /cam/image_stabilized, nobody publishes it"
    assert values["displacement_reference_px.count"] == "0"
    assert values["displacement_reference_px.median"] == ""


def test_a_calm_stream_is_ok_and_counted() -> None:
    stream = StatusFeed()
    stream.frame(outcome=Outcome.REFERENCE)
    for value in (0.1, 0.3, 0.2):
        stream.frame(displacement_reference_px=value)
    level, message, values = stream.says()
    assert (level, message) == (Level.OK, "no problem up to frame 3 (0.120 s)")
    assert (values["state"], values["frames_in"], values["frames_measured"]) == ("MEASURING", "4", "3")
    assert {f"{name}.{key}" for name in UNITS for key in ("median", "p95", "max", "count")} <= values.keys()
    assert [float(values[f"displacement_reference_px.{key}"]) for key in ("median", "p95", "max", "count")] \
        == pytest.approx([0.2, 0.29, 0.3, 3])


def test_a_finding_raises_the_level_names_its_frame_and_fades() -> None:
    stream = StatusFeed(alarm_s=3)
    stream.frame()
    stream.frame(Finding(Level.ERROR, "frame 1 (0.040 s): displaced by 3.00 px against the reference"))
    for _ in range(70):
        stream.frame()
    assert stream.says()[:2] == (Level.ERROR, "frame 1 (0.040 s): displaced by 3.00 px against the reference")
    for _ in range(10):
        stream.frame()
    assert stream.says()[:2] == (Level.OK, "no problem up to frame 81 (3.240 s)")


def test_equal_problems_are_merged_and_the_worst_comes_first() -> None:
    stream = StatusFeed()
    for _ in range(3):
        stream.frame(Finding(Level.WARN, f"frame {stream.number + 1}: brightness changed by +4.{stream.number + 1} %"))
    stream.frame(Finding(Level.ERROR, "frame 3 is lost"))
    level, message, _ = stream.says()
    assert level == Level.ERROR
    assert message == ("frame 3 is lost; frame 0: brightness changed by +4.0 % "
                       "(and 2 more until frame 2 (0.080 s))")


def test_no_more_than_three_kinds_of_problems_are_reported() -> None:
    stream = StatusFeed()
    stream.frame(*(Finding(Level.WARN, f"frame 0: trouble of kind {kind}") for kind in "abcde"))
    assert stream.says()[1].endswith("kind c; and 2 more")


def test_a_stream_that_stops_is_an_error_that_names_the_last_frame() -> None:
    stream = StatusFeed(stale_s=1)
    stream.frame()
    stream.frame()
    stream.now_ns += 1_500_000_000
    level, message, values = stream.says()
    assert (level, values["state"]) == (Level.ERROR, "STALE")
    assert message == "no image for 1.5 s, the last was frame 1 (0.040 s)"
    stream.frame()
    assert stream.says()[0] == Level.OK


def test_an_inactive_evaluator_is_told_of_frames_but_of_no_silence() -> None:
    stream = StatusFeed(alarm_s=10)
    stream.frame(Finding(Level.WARN, "rmsd_reference 9 is high"), rmsd_reference=9.0)
    stream.now_ns += 5 * SECOND_NS
    assert stream.says()[0] == Level.ERROR
    report = stream.status.report(stream.now_ns, 0, stream.now_ns).while_inactive()
    assert (report.level, report.values["state"]) == (Level.WARN, "INACTIVE")
    assert "no image for" not in report.message
    assert "rmsd_reference 9 is high" in report.message


def test_skipped_frames_and_checks_are_reported() -> None:
    stream = StatusFeed()
    stream.frame()
    stream.status.on_skipped(stream.arrival(), stream.now_ns)
    stream.status.on_check_skipped(stream.arrival(), stream.now_ns)
    level, message, values = stream.says(delay_ns=2 * SECOND_NS)
    assert level == Level.WARN
    assert "frame 0 (0.000 s) is skipped, too many are waiting" in message
    assert "frame 0 (0.000 s): RMSE and velocity field are skipped" in message
    assert "2.0 s behind" in message
    assert (values["frames_skipped"], values["checks_skipped"], values["delay_s"]) == ("1", "1", "2.000")


def test_refused_messages_are_reported() -> None:
    stream = StatusFeed()
    stream.frame()
    stream.status.on_refused(Level.WARN, "refused a message: /cam/image_stabilized: too short", stream.now_ns)
    level, message, values = stream.says()
    assert (level, message) == (Level.WARN, "refused a message: /cam/image_stabilized: too short")
    assert values["frames_refused"] == "1"


def test_statistics_forget_what_is_older_than_their_window() -> None:
    stream = StatusFeed(window_s=1)
    stream.frame(displacement_reference_px=9.0)
    for _ in range(30):
        stream.frame(displacement_reference_px=0.1, velocity_error_m_s=0.024)
    values = stream.says()[2]
    assert values["displacement_reference_px.max"] == "0.1"
    assert int(values["displacement_reference_px.count"]) == pytest.approx(25, abs=1)
    assert values["velocity_error_m_s"] == "0.024", "the latest"
    assert values["frames_measured"] == "31", "counts are since the start"
