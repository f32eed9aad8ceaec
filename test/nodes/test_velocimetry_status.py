"""What the report of velocimetry on /diagnostics says of vectors that were dropped."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import Frame
from stab_ros.nodes.velocimetry_status import VelocimetryStatus
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.speeds import joined
from stab_ros.velocimetry.velocimeter import Measured
from stab_ros.velocimetry.zone import Zone

IMAGE = np.zeros((4, 4), np.uint8)


def measured(**dropped: int) -> Measured:
    frame, placed = Frame(IMAGE, "mono8", 0), PlacedFrame(0, IMAGE, np.eye(3), np.zeros((8, 8)))
    return Measured(frame, placed, 0, joined([]), 0.0, Zone(np.eye(3), None), dropped)


def test_counts_by_reason_and_tells_of_a_bed_once() -> None:
    status = VelocimetryStatus("stationary_nadir", 10**9, "m")
    status.on_measured(measured(dragged=0, local_median=2), 0)
    assert "bed" not in status.report(0).message
    status.on_measured(measured(dragged=9, local_median=1), 0)
    report = status.report(0)
    assert "9 vectors were dropped" in report.message
    assert (report.values["dropped_dragged"], report.values["dropped_local_median"]) == ("9", "3")
    status.on_measured(measured(dragged=9, local_median=1), 0)
    report = status.report(0)
    assert "bed" not in report.message
    assert report.values["dropped_dragged"] == "18"
