"""The report of georeferencing on /diagnostics."""

from __future__ import annotations

from stab_ros.io.diagnostics_message import ERROR, OK, WARN
from stab_ros.nodes.georeference_status import GeoreferenceStatus, Result

SECOND = 10**9


def placed(stamp_s: float = 1.0, *warnings: str) -> Result:
    return Result(round(stamp_s * SECOND), "", warnings, {"gsd_m": "0.05"}, 3_000_000)


def test_waits_until_a_frame_is_answered() -> None:
    status = GeoreferenceStatus("stationary_nadir", 2 * SECOND)
    status.waiting_for = "images on /a"
    report = status.report(0)
    assert (report.level, report.message, report.values["state"]) == (WARN, "waiting for images on /a", "WAITING")
    status.on_image(0)
    status.on_result(placed())
    report = status.report(SECOND)
    assert (report.level, report.message) == (OK, "placed")
    wanted = {"state": "PLACED", "frames_in": "1", "frames_placed": "1", "frames_unplaced": "0", "gsd_m": "0.05",
              "latency_ms": "3.000", "orientation": "stationary_nadir"}
    assert wanted.items() <= report.values.items()
    assert status.report(3 * SECOND).level == ERROR


def test_a_stream_that_pauses_says_what_its_frames_wait_for() -> None:
    status = GeoreferenceStatus("dynamic_stabilization", 2 * SECOND)
    status.on_image(0)
    status.on_result(placed())
    status.waiting, status.waiting_for = 74, "messages on /cam/homography"
    report = status.report(9 * SECOND)
    assert report.message == "74 frames wait for messages on /cam/homography; no image for 9.0 s"
    assert (report.level, report.values["state"]) == (ERROR, "STALE")
    status.waiting = 0
    assert status.report(9 * SECOND).message == "no image for 9.0 s"


def test_unplaced_frame_says_why() -> None:
    status = GeoreferenceStatus("stationary_nadir", 2 * SECOND)
    status.on_image(0)
    status.on_result(Result(SECOND, "the horizon", (), {}, 0))
    report = status.report(0)
    assert (report.level, report.message, report.values["state"]) == (WARN, "unplaced: the horizon", "UNPLACED")


def test_doubts_last_as_long_as_they_hold_and_events_are_told_once() -> None:
    status = GeoreferenceStatus("stationary_nadir", 2 * SECOND)
    status.on_image(0)
    status.on_result(placed(1.0, "focal length and height cannot be told apart"))
    status.warn("reset", "homographies begin anew")
    status.faults, status.silent = {"/level": "/level is published as String"}, ("fix",)
    assert status.report(0).message.split("; ") == [
        "placed", "focal length and height cannot be told apart", "/level is published as String",
        "fix is silent, frames do not wait for it", "homographies begin anew"]
    status.faults, status.silent = {}, ()
    assert status.report(0).message == "placed; focal length and height cannot be told apart"
    status.on_result(placed())
    assert status.report(0).level == OK


def test_age_of_sensors_is_that_of_their_stamps() -> None:
    status = GeoreferenceStatus("dynamic_gps_imu", 2 * SECOND)
    status.on_sample("fix", 4 * SECOND)
    status.on_sample("fix", 3 * SECOND)  # late
    status.on_result(placed(6.5))
    assert status.report(0).values["fix_age_s"] == "2.5"
    status.restart()
    assert "fix_age_s" not in status.report(0).values


def test_an_inactive_node_is_told_of_what_prevents_any_place_and_of_no_fault_of_the_stream() -> None:
    status = GeoreferenceStatus("stationary_gcps", SECOND)
    status.on_image(0)
    status.on_result(placed(1.0, "focal length and height cannot be told apart"))
    status.faults = {"/level": "/level is published as String"}
    assert status.report(9 * SECOND).level == ERROR
    report = status.report(9 * SECOND).while_inactive()
    assert (report.level, report.message, report.values["state"]) == (OK, "takes no images", "INACTIVE")
    status.unmade = "the points do not fit"
    status.warn("reset", "homographies begin anew")
    report = status.report(9 * SECOND).while_inactive()
    assert report.level == ERROR
    assert report.message == "no frame can be placed: the points do not fit; homographies begin anew"
