"""The message on `track`, read by the real ROS 2 (rclpy)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from message_makers import HEADER
from rclpy.serialization import deserialize_message

from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import FloatArray, LostReason, ResetReason, State, Track
from stab_ros.io.cdr import read_stamp
from stab_ros.io.diagnostics_message import read_values
from stab_ros.io.track_message import track_cdr

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
