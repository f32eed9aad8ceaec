"""The status of the tracker: state, counts and warnings."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import LostReason, State, Track
from stab_ros.io.advice import ambiguous_ground, parallax, rolling_shutter
from stab_ros.nodes.tracker_status import TrackerStatus
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.planes import Plane
from stab_ros.tracking.rolling_shutter import Swing

SECOND_NS = 10**9


def a_track(state: State, number: int = 0) -> Track:
    if state is State.LOST:
        return Track(state, number, number, 0, 0, matches=40, lost_reason=LostReason.FEW_INLIERS)
    return Track(state, number, number, 0, 0, 50, 45, np.eye(3), np.eye(8), 0.25, 0.125)


def test_status_counts_what_happens() -> None:
    status = TrackerStatus("direct", stale_ns=2 * SECOND_NS)
    status.waiting_for = "images on /image_raw"
    before = status.report(0)
    assert (before.level, before.message, before.values["state"]) == (1, "waiting for images on /image_raw", "WAITING")
    status.on_image(SECOND_NS)
    status.on_track(a_track(State.TRACKED), latency_ns=12_345_678)
    status.on_dropped(3)
    report = status.report(2 * SECOND_NS)
    assert (report.level, report.message) == (0, "tracked")
    assert report.values == {
        "state": "TRACKED", "method": "direct", "frames_in": "1", "frames_tracked": "1", "frames_lost": "0",
        "lost_reason": "",
        "frames_dropped": "3", "frames_refused": "0", "frames_before": "0",
        "internal_errors": "0", "matches": "50", "inliers": "45",
        "rmse_px": "0.25", "sigma_px": "0.125", "latency_ms": "12.346", "reset_counter": "0", "ground": "undecided",
        "rival_share": "", "parallax_px": "", "parallax_deg": "", "rows_px": "",
    }


def test_status_of_lost_refused_and_missing_frames() -> None:
    status = TrackerStatus("klt", stale_ns=2 * SECOND_NS)
    status.on_image(0)
    status.on_track(a_track(State.LOST), latency_ns=1)
    status.on_refused()
    status.warn("refused", "refused an image: step 0")
    status.warn("refused", "refused an image: step is too short")
    report = status.report(SECOND_NS)
    assert (report.level, report.message) == (1, "lost: too few inliers; refused an image: step is too short")
    assert (report.values["rmse_px"], report.values["frames_in"], report.values["frames_lost"]) == ("", "2", "1")
    assert report.values["lost_reason"] == "too few inliers"
    stale = status.report(5 * SECOND_NS)
    assert (stale.level, stale.message, stale.values["state"]) == (2, "no image for 5.0 s", "STALE")


def test_ambiguous_ground_parallax_and_swinging_rows_are_in_every_report() -> None:
    status = TrackerStatus("direct", stale_ns=2 * SECOND_NS)
    status.on_image(0)
    status.on_track(a_track(State.TRACKED), latency_ns=1)
    plane = Plane(np.ones(4, bool), np.eye(3)[None])
    status.competing = CompetingHypothesis(plane, 0.25, (3.0, 0.0), (0.0, 0.0), (3.0, 4.0), 1.0, 1.0)
    status.relief, status.swing = Relief(0.125, 30.0), Swing(7, 0.5)
    for _ in range(2):
        report = status.report(SECOND_NS)
        assert report.level == 1
        assert report.message == "; ".join(
            ["tracked", ambiguous_ground(status.competing), parallax(status.relief), rolling_shutter(status.swing)])
        assert [report.values[key] for key in ("rival_share", "parallax_px", "rows_px")] == ["0.25", "0.125", "0.5"]


def test_sleep_is_no_fault_and_the_silence_of_it_is_not_told() -> None:
    status = TrackerStatus("direct", stale_ns=2 * SECOND_NS)
    status.on_image(0)
    status.on_track(a_track(State.TRACKED), latency_ns=1)
    status.asleep = True
    status.timeout.suspend()
    report = status.report(100 * SECOND_NS)
    assert (report.level, report.message) == (0, "asleep until somebody listens")
    assert report.values["state"] == "ASLEEP"
    status.asleep = False
    report = status.report(101 * SECOND_NS)
    assert (report.level, report.values["state"]) == (1, "WAITING"), "until images come"
    assert status.on_image(102 * SECOND_NS) == 0.0
    assert status.report(103 * SECOND_NS).values["state"] == "TRACKED"


def test_an_inactive_node_has_no_fault_but_what_was_said_since() -> None:
    status = TrackerStatus("direct", stale_ns=2 * SECOND_NS)
    status.warn("reference_path", "the reference is not saved: disk full")
    report = status.report(100 * SECOND_NS).while_inactive()
    assert (report.level, report.message) == (1, "takes no images; the reference is not saved: disk full")
    report = status.report(101 * SECOND_NS).while_inactive()
    assert (report.level, report.message, report.values["state"]) == (0, "takes no images", "INACTIVE")
