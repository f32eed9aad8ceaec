"""The metrics of one stabilised frame, under their names on the topic `~/metrics`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from enum import Enum

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.metrics.velocity_field import Field


class Outcome(Enum):
    """How the evaluation of a frame ended; statistics include only MEASURED frames."""

    REFERENCE = "REFERENCE"
    MEASURED = "MEASURED"
    LOST = "LOST"
    NO_IMAGE = "NO_IMAGE"

    @property
    def has_picture(self) -> bool:
        """Whether the frame has a usable image."""
        return self in (Outcome.REFERENCE, Outcome.MEASURED)


# name and unit of every metric of a frame; those of the contract first
UNITS: Mapping[str, str] = {
    "rmsd_reference": "grey levels",
    "rmsd_previous": "grey levels",
    "displacement_reference_px": "px",
    "displacement_previous_px": "px",
    "rmse_reference_px": "px",
    "rmse_previous_px": "px",
    "checkpoints": "",
    "shift_u_px": "px",
    "shift_v_px": "px",
    "position_error_m": "m",
    "velocity_error_m_s": "m/s",
    "brightness_change": "",
    "noise_sigma": "grey levels",
    "points_used": "",
    "points_beyond_range": "",
    "identical_frames": "",
    "points_fixed_to_camera": "",
}
# what they are called in tables and reports
TITLES: Mapping[str, str] = {
    "rmsd_reference": "difference to the reference (RMSD)",
    "rmsd_previous": "difference to the frame before (RMSD)",
    "displacement_reference_px": "displacement from the reference",
    "displacement_previous_px": "displacement from frame to frame",
    "rmse_reference_px": "homologous points, reference (RMSE)",
    "rmse_previous_px": "homologous points, frame to frame (RMSE)",
    "checkpoints": "number of homologous points",
    "shift_u_px": "shift to the right",
    "shift_v_px": "shift down",
    "position_error_m": "error of positions",
    "velocity_error_m_s": "error of velocities",
    "brightness_change": "change of brightness, 1 = 100 %",
    "noise_sigma": "noise of the camera",
    "points_used": "verification points in the means",
    "points_beyond_range": "of these, beyond their range",
    "identical_frames": "same picture before, times in a row",
    "points_fixed_to_camera": "points that move with the camera",
}
COUNTS = frozenset({"checkpoints", "points_used", "points_beyond_range", "identical_frames", "points_fixed_to_camera"})
# metrics that every verification point has as well
POINT_METRICS = ("rmsd_reference", "rmsd_previous", "displacement_reference_px", "displacement_previous_px",
                 "shift_u_px", "shift_v_px")


def _no_points() -> Mapping[str, FloatArray]:
    return {name: np.empty(0) for name in POINT_METRICS}


@dataclasses.dataclass(frozen=True, eq=False)
class FrameMetrics:
    """The measures of one frame.

    Attributes:
        frame: number of the frame in the stream, from 0.
        stamp_ns: the header stamp of the frame, ns.
        outcome: whether the frame was measured, is the reference, is lost or came without an image.
        values: value by the names of `UNITS`, means over the static points; a missing name could not be measured.
        points: for each name of `POINT_METRICS` the values of all verification points, (n,), NaN where there is none.
        static: (n,) bool, the points that count in the means.
        field: the residual velocity field, where it was due.
        beyond: (n,) bool, the points whose displacement from the reference exceeds the range that can be measured.
    """

    frame: int
    stamp_ns: int
    outcome: Outcome
    values: Mapping[str, float] = dataclasses.field(default_factory=dict)
    points: Mapping[str, FloatArray] = dataclasses.field(default_factory=_no_points)
    static: BoolArray = dataclasses.field(default_factory=lambda: np.empty(0, bool))
    field: Field | None = None
    beyond: BoolArray = dataclasses.field(default_factory=lambda: np.empty(0, bool))

    def __getitem__(self, name: str) -> float | None:
        return self.values.get(name)
