"""Tables of gaugings: pairs of stage and discharge, for a rating curve."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from stab_ros.core.errors import InputError, WorkError
from stab_ros.core.text import number, one_line
from stab_ros.discharge.rating import Gauging
from stab_ros.io.csv_rows import csv_rows

COLUMNS = ("stage_m", "discharge_m3_s", "sigma_m3_s", "shared_sigma", "source", "own_sigma", "recording")
_NEEDED = COLUMNS[:2]


def read_gaugings(path: Path) -> tuple[Gauging, ...]:
    """Reads a table with the columns `stage_m` and `discharge_m3_s`; the others of COLUMNS may be missing or empty.

    Raises:
        InputError: the file or a needed column is missing, or a cell is no number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            names = next(csv.reader(file, strict=True), [])
            missing = [name for name in _NEEDED if name not in names]
            if missing:
                raise InputError(f"{path}: no column {missing[0]}; it must be a table of gaugings, {','.join(COLUMNS)}")
            file.seek(0)
            rows = csv_rows(file, [name for name in COLUMNS if name in names])
            next(rows)
            return tuple(_gauging(path, line, dict(zip((name for name in COLUMNS if name in names), row, strict=True)))
                         for line, row in rows)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; it must be a table of gaugings, {','.join(COLUMNS)}") from error
    except (ValueError, csv.Error) as error:  # ValueError: not UTF-8, or no possible name of a file
        raise InputError(f"{path}: is no table, it must be one of gaugings, {','.join(COLUMNS)}") from error


def _gauging(path: Path, line: int, row: dict[str, str]) -> Gauging:
    try:
        stage, q = (float(row[name]) for name in _NEEDED)
        sigma, shared = (float(row.get(name) or 0.0) for name in ("sigma_m3_s", "shared_sigma"))
        own = float(row["own_sigma"]) if row.get("own_sigma") else None
        if not all(map(math.isfinite, (stage, q, sigma, shared, own or 0.0))):
            raise ValueError("a number is not finite")
        return Gauging(stage, q, sigma, shared, row.get("source", ""), own, row.get("recording", ""))
    except (ValueError, InputError) as error:
        raise InputError(f"{path}: line {line}: {one_line(error)[:200]}") from error


def write_gaugings(gaugings: Sequence[Gauging], path: Path) -> None:
    """Raises WorkError where the file cannot be written."""
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            for one in gaugings:
                numbers = one.stage_m, one.q_m3_s, one.sigma_m3_s, one.shared_sigma
                table.writerow([*map(number, numbers), one.source, number(one.own_sigma), one.recording])
    except OSError as error:
        raise WorkError(f"{path}: {error.strerror}") from error
