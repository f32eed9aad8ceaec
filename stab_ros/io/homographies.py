"""Homographies as a table (H.csv): a row for every input frame, empty cells where a frame was lost.

Truth files have the same first columns, `frame` to `h22`, and are joined by frame.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.text import number, one_line
from stab_ros.core.types import Homography, State, Track
from stab_ros.io.csv_rows import csv_rows, whole_of
from stab_ros.io.csv_table import CsvTable

ELEMENTS = tuple(f"h{row}{column}" for row in range(3) for column in range(3))
COLUMNS = ("frame", "stamp_ns", "status", *ELEMENTS)
TRACK_COLUMNS = ("matches", "inliers", "rmse_px", "sigma_px", "reset_counter", "lost_reason", "reset_reason")


@dataclass(frozen=True, eq=False, slots=True)
class HomographyRow:
    """One row of a table of homographies.

    Attributes:
        frame: number of the frame in the input, from 0.
        stamp_ns: the header stamp of the frame, ns.
        ref_H_cur: (3, 3) float64, maps pixels of the frame to pixels of the reference; None while lost.
    """

    frame: int
    stamp_ns: int
    ref_H_cur: Homography | None


class HomographyWriter(CsvTable):
    """Writes a table of homographies (`H.csv`).

    Args:
        path: the file; an existing one is overwritten.

    Raises:
        WorkError: the file cannot be written (any method).
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.rows([(*COLUMNS, *TRACK_COLUMNS)])

    def write(self, frame: int, track: Track) -> None:
        """Appends a row.

        Args:
            frame: number of the frame in the input, from 0; images that cannot be decoded count.
            track: the answer for the frame.
        """
        self.rows([_cells(frame, track)])


def _cells(frame: int, track: Track) -> list[str]:
    elements = [""] * 9 if track.ref_H_cur is None else [number(float(h)) for h in track.ref_H_cur.ravel()]
    return [
        str(frame), str(track.stamp_ns), track.state.value, *elements,
        str(track.matches), str(track.inliers), number(track.rmse_px), number(track.sigma_px),
        str(track.reset_counter), "" if track.lost_reason is None else track.lost_reason.value,
        "" if track.reset_reason is None else track.reset_reason.value,
    ]  # fmt: skip


def read_homographies(path: Path) -> list[HomographyRow]:
    """Reads `H.csv` or a truth file.

    Args:
        path: the file; columns after h22 are ignored.

    Returns:
        The rows in the order of the file.

    Raises:
        InputError: the file is missing, a column is missing, or a cell is not a number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv_rows(file, COLUMNS)
            missing = next(rows)[1]
            if missing:
                raise InputError(f"{path}: no column {missing[0]}; the header must begin with {','.join(COLUMNS)}, "
                                 "separated by commas")
            return [_row(path, line, cells) for line, cells in rows]
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; it must be a table of homographies (.csv)") from error
    except (ValueError, csv.Error) as error:  # ValueError: not UTF-8, or no possible name of a file
        raise InputError(f"{path}: not a table of homographies, a .csv that begins with {','.join(COLUMNS)}") from error


def _row(path: Path, line: int, cells: Sequence[str]) -> HomographyRow:
    frame, stamp_ns, status, *elements = cells
    try:
        matrix = None if status == State.LOST.value else _matrix(elements)
        return HomographyRow(whole_of("frame", frame), whole_of("stamp_ns", stamp_ns), matrix)
    except ValueError as error:
        raise InputError(f"{path}: line {line} is not a row of homographies: {one_line(error)[:200]}") from error


def _matrix(cells: Sequence[str]) -> Homography:
    elements = [float(cell) for cell in cells]
    if not all(map(math.isfinite, elements)):
        raise ValueError("a homography must be finite")
    return np.array(elements, np.float64).reshape(3, 3)
