"""The true homographies of a flight, against which the methods are measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import normalized, rms_distance
from stab_ros.core.text import counted
from stab_ros.core.types import Homography
from stab_ros.io.homographies import read_homographies


class Truth:
    """A truth file, joined to the input by frame number; a row without a homography means that it is unknown.

    Raises:
        InputError: no such file, no table of homographies, a frame twice, or no homography at all.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        rows = read_homographies(path)
        self._true = {row.frame: row.ref_H_cur for row in rows}
        if len(self._true) < len(rows):
            numbers = [row.frame for row in rows]
            twice = next(frame for frame in numbers if numbers.count(frame) > 1)
            raise InputError(f"{path}: has frame {twice} twice, every frame must have one row")
        if not any(H is not None for H in self._true.values()):
            raise InputError(f"{path}: holds no homography, it must have a row with h00 to h22 for every frame")

    def check(self, frames: int, source: str) -> None:
        """Raises InputError unless every frame from 0 to `frames` - 1 has a row."""
        missing = next((frame for frame in range(frames) if frame not in self._true), None)
        if missing is not None:
            raise InputError(f"{self._path}: does not fit {source}, it has no row for frame {missing}; it must have "
                             f"one for each of {counted(frames, 'frame')} (status LOST where the truth is not known)")

    def beyond(self, frames: int) -> int:
        """Number of rows outside of frames 0 to `frames` - 1."""
        return sum(not 0 <= frame < frames for frame in self._true)

    def error_px(self, frame: int, reference: int, ref_H_cur: Homography, size: tuple[int, int]) -> float | None:
        """RMS distance over the 9x9 grid of the frame; None where the truth is unknown.

        reference: number of the reference frame of `ref_H_cur`, which may differ from that of the truth.
        """
        true, true_of_reference = self._true.get(frame), self._true.get(reference)
        if true is None or true_of_reference is None:
            return None
        return rms_distance(ref_H_cur, normalized(np.linalg.inv(true_of_reference) @ true), size)
