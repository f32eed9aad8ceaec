"""The same flight through the command, without ROS; the live nodes must give the same homographies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from stab_ros.core.types import Homography
from stab_ros.demo.result import Answers
from stab_ros.demo.stages import bar
from stab_ros.io.homographies import HomographyRow, read_homographies
from stab_ros.jobs.stabilize import Job, stabilize


def as_command(recording: Path, table: Path) -> list[HomographyRow]:
    """Runs `stab-ros stabilize RECORDING OUT.mcap --homographies TABLE` and returns the rows of the table.

    Raises:
        InputError: the recording is unreadable. WorkError: the table cannot be written.
    """
    with TemporaryDirectory() as folder, bar("as command") as progress:
        stabilize(Job(recording, Path(folder) / "out.mcap", {}, homographies=table, with_image=False, force=True),
                  progress)
    return read_homographies(table)


@dataclass(frozen=True)
class Apart:
    """The largest difference of an element of two homographies, infinite if one is lost. frame: its frame."""

    largest: float
    frame: int


def apart(command: Sequence[HomographyRow], answers: Answers) -> Apart:
    """The difference between live homographies and those of the command, over the answered frames."""
    answered = [row for row in command if row.stamp_ns in answers.homographies]
    each = [Apart(_difference(answers.homographies[row.stamp_ns], row.ref_H_cur), row.frame) for row in answered]
    return max(each, key=lambda one: one.largest, default=Apart(0.0, 0))


def _difference(one: Homography | None, other: Homography | None) -> float:
    if one is None or other is None:
        return 0.0 if one is other else float("inf")
    return float(np.abs(one - other).max())
