"""The message on `track`, read by the real ROS 2 (rclpy)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from message_makers import HEADER
from rclpy.serialization import deserialize_message

from stab_ros.core.errors import MessageError
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import FloatArray, LostReason, ResetReason, State, Track
from stab_ros.imaging.window import Window
from stab_ros.io.cdr import read_stamp
from stab_ros.io.diagnostics_message import OK, read_values, status_cdr
from stab_ros.io.track_message import read_track, track_cdr

TILTED = np.array([[1.01, 0.02, -7.3], [-0.015, 0.99, 4.6], [1e-5, -2e-5, 1.0]])


def track(H: FloatArray | None) -> Track:
    if H is None:
        return Track(State.LOST, 3, HEADER.stamp_ns, 5, 1, 40, lost_reason=LostReason.FEW_INLIERS)
    return Track(State.TRACKED, 3, HEADER.stamp_ns, 5, 1, 40, 38, H, np.arange(64.0).reshape(8, 8) / 7, 0.1, 0.02)


def test_track_in_full() -> None:
    cdr = track_cdr(track(TILTED), HEADER)
    values = read_values(cdr)
    covariance = track(TILTED).covariance
    assert covariance is not None
    assert list(values) == ["state", "reference_stamp_ns", "reset_counter", "matches", "inliers", "rmse_px", "sigma_px",
                            "covariance", "offset", "scale", "provisional", "rows_px",
                            "simpler_model", "lost_reason", "reset_reason"]
    assert [float(number) for number in values.pop("covariance").split()] == list(covariance[np.triu_indices(8)])
    assert list(values.values()) == ["TRACKED", "5", "1", "40", "38", "0.1", "0.02", "0 0", "1", "false", *[""] * 4]
    assert deserialize_message(cdr, DiagnosticArray).status[0].level == b"\x00"
    assert read_stamp(cdr) == HEADER.stamp_ns


def test_track_tells_how_far_rows_have_swung() -> None:
    rows = RowShifts(np.tile([3.0, 4.0], (8, 1)), 100)
    values = read_values(track_cdr(replace(track(TILTED), rows=rows), HEADER))
    assert float(values["rows_px"]) == pytest.approx(5.0)


def test_track_tells_why_homographies_began_anew() -> None:
    values = read_values(track_cdr(replace(track(TILTED), reset_reason=ResetReason.SIZE), HEADER))
    assert (values["reset_counter"], values["reset_reason"]) == ("1", "other size")


def test_track_while_lost_leaves_the_unknown_empty() -> None:
    values = read_values(track_cdr(replace(track(None), matches=7), HEADER))
    assert (values["state"], values["matches"], values["lost_reason"]) == ("LOST", "7", "too few inliers")
    assert values["rmse_px"] == values["sigma_px"] == values["covariance"] == ""


def test_track_is_read_as_it_was_written() -> None:
    window = Window(-100, 40, (800, 600), 0.5)
    sent = replace(track(TILTED), covariance=np.eye(8) + np.ones((8, 8)) / 3)
    read = read_track(track_cdr(sent, HEADER, window))
    assert (read.stamp_ns, read.reset_counter) == (HEADER.stamp_ns, 1)
    assert read.covariance is not None
    np.testing.assert_array_equal(read.covariance, sent.covariance)
    np.testing.assert_allclose(read.window_H_ref, window.window_H_cur(np.eye(3)), rtol=0, atol=1e-9)
    assert read_track(track_cdr(track(None), HEADER)).covariance is None


@pytest.mark.parametrize("wrong", [
    {"covariance": "1 2"}, {"covariance": "nan " * 36}, {"scale": "0"}, {"offset": "1"}, {"reset_counter": "x"}])
def test_track_of_another_program_is_refused(wrong: dict[str, str]) -> None:
    values = read_values(track_cdr(track(TILTED), HEADER)) | wrong
    with pytest.raises(MessageError, match="as the tracker writes them"):
        read_track(status_cdr(HEADER, "track", "", OK, "", values))
    with pytest.raises(MessageError):
        read_track(status_cdr(HEADER, "track", "", OK, "", {}))
