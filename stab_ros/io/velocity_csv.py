"""Velocity vectors as a table (V.csv): a row for every vector, in full double precision.

The first five columns are those of KLT-IV's `_VelocityOutputs.csv`: X, Y, X component, Y component, magnitude. Without
georeference, `_px` stands for `_m` in the names of all columns.

`var_vx`, `cov_vxvy` and `var_vy` are of the error that a vector has by itself. `shared_vx_0`, `shared_vy_0`, ... are
the changes of the velocity by one standard deviation of each common error. `sigma_speed_m_s` is of both together.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.text import number, one_line
from stab_ros.core.types import FloatArray, IdArray
from stab_ros.io.csv_rows import csv_rows, whole_of
from stab_ros.io.csv_table import CsvTable
from stab_ros.velocimetry.speeds import sigma_speed_m_s
from stab_ros.velocimetry.vectors import Unit, Vectors

# in metres; {0} is the unit
_KLT_IV = ("x_start_{0}", "y_start_{0}", "vx_{0}_s", "vy_{0}_s", "speed_{0}_s")
_OWN = ("x_end_{0}", "y_end_{0}", "dt_s", "sigma_speed_{0}_s", "var_vx", "cov_vxvy", "var_vy")
_WHOLE = ("start_ns", "end_ns", "track_id")
_READ = ("x_start_{0}", "y_start_{0}", "x_end_{0}", "y_end_{0}", "var_vx", "cov_vxvy", "var_vy")
_TOLD = ("vx_{0}_s", "vy_{0}_s")  # again by start, end and stamps, with which they must agree
_AGREE = 1e-3  # relative, and m/s: of numbers that were rounded on their way
_UNITS: tuple[Unit, ...] = ("m", "px")


class VelocityWriter(CsvTable):
    """Writes a table of vectors. The header follows with the first vectors, which tell unit and common errors.

    Args:
        path: the file; an existing one is overwritten.

    Raises:
        WorkError: the file cannot be written (any method).
    """

    def __init__(self, path: Path, unit: Unit = "m") -> None:
        super().__init__(path)
        self._unit: Unit = unit
        self._shared: int | None = None  # number of common errors

    def write(self, vectors: Vectors) -> None:
        """Appends a row for each vector.

        Raises:
            ValueError: in another unit, or with another number of common errors than those before.
        """
        if not len(vectors):
            return
        self._begin(vectors.shared.shape[2])
        if vectors.unit != self._unit or vectors.shared.shape[2] != self._shared:
            raise ValueError(f"vectors in {vectors.unit} with {vectors.shared.shape[2]} common errors follow those in "
                             f"{self._unit} with {self._shared}")
        self.rows(_rows(vectors))

    def close(self) -> None:
        """Closes the file; one without vectors has its header."""
        self._begin(0)
        super().close()

    def _begin(self, shared: int) -> None:
        if self._shared is None:
            self._shared = shared
            self.rows([_header(self._unit, shared)])


def _header(unit: Unit, shared: int) -> list[str]:
    names = [name.format(unit) for name in (*_KLT_IV, *_OWN)]
    return [*names, *_WHOLE, *(f"shared_{v}_{k}" for k in range(shared) for v in ("vx", "vy"))]


def _rows(vectors: Vectors) -> Iterator[list[str]]:
    v, own = vectors.velocity_m_s, vectors.covariance
    real = np.column_stack([
        vectors.start_m, v, np.hypot(*v.T), vectors.end_m, vectors.dt_s, sigma_speed_m_s(vectors), own[:, 0, 0],
        own[:, 0, 1], own[:, 1, 1]])
    whole = np.column_stack([vectors.start_ns, vectors.end_ns, vectors.track_id])
    shared = vectors.shared.transpose(0, 2, 1).reshape(len(vectors), -1)
    for numbers, counts, common in zip(real.tolist(), whole.tolist(), shared.tolist(), strict=True):
        yield [*map(number, numbers), *map(str, counts), *map(number, common)]


def read_velocities(path: Path) -> Vectors:
    """Reads `V.csv`; what was written comes back exactly.

    Args:
        path: the file; columns of other names are ignored.

    Returns:
        The vectors in the order of the file.

    Raises:
        InputError: the file is missing, a column is missing, or a cell is not a finite number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            names = next(csv.reader(file, strict=True), [])
            unit = next((unit for unit in _UNITS if _READ[0].format(unit) in names), _UNITS[0])
            common = [f"shared_{v}_{k}" for k in range(_common(names)) for v in ("vx", "vy")]
            file.seek(0)
            told = [name for name in (one.format(unit) for one in _TOLD) if name in names]
            rows = csv_rows(file, [*(name.format(unit) for name in _READ), *common, *told, *_WHOLE])
            missing = next(rows)[1]
            if missing:
                raise InputError(f"{path}: no column {missing[0]}; it must be a table of velocities as stab-ros "
                                 "velocity writes it with --csv, separated by commas")
            lines, cells = [], []
            for line, row in rows:
                lines.append(line)
                cells.append(_numbers(path, line, row))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; it must be a table of velocities (.csv)") from error
    except (ValueError, csv.Error) as error:  # ValueError: not UTF-8, or no possible name of a file
        raise InputError(f"{path}: not a table of velocities, as stab-ros velocity writes it with --csv") from error
    vectors = _vectors(path, cells, unit, len(common))
    if len(told) == len(_TOLD):
        _check_told(path, vectors, np.array([real[-2:] for real, _ in cells]).reshape(-1, 2), lines)
    return vectors


def _check_told(path: Path, vectors: Vectors, told_m_s: FloatArray, lines: Sequence[int]) -> None:
    """Raises InputError where a table was changed in part: its velocities (n, 2) are not those of start and end."""
    v = vectors.velocity_m_s
    off = np.flatnonzero((np.abs(v - told_m_s) > _AGREE * (1 + np.abs(v))).any(axis=1)).tolist()
    if off:
        raise InputError(f"{path}: line {lines[off[0]]}{f' and {len(off) - 1} more' if off[1:] else ''}: vx and vy are "
                         "not those of start, end and stamps, from which they are read; leave out or change whole rows")


def _common(names: Sequence[str]) -> int:
    """The number of common errors in a header."""
    return sum(name.startswith("shared_vx_") for name in names)


def _numbers(path: Path, line: int, cells: Sequence[str]) -> tuple[list[float], list[int]]:
    try:
        real = [float(cell) for cell in cells[: -len(_WHOLE)]]
        if not all(map(math.isfinite, real)):
            raise ValueError("a number is not finite")
        return real, [whole_of(*one) for one in zip(_WHOLE, cells[-len(_WHOLE):], strict=True)]
    except ValueError as error:
        raise InputError(f"{path}: line {line} is not a row of velocities: {one_line(error)[:200]}") from error


def _vectors(path: Path, rows: Sequence[tuple[list[float], list[int]]], unit: Unit, common: int) -> Vectors:
    columns = len(_READ) + common
    real: FloatArray = np.array([row[:columns] for row, _ in rows], np.float64).reshape(-1, columns)
    try:
        whole: IdArray = np.array([row for _, row in rows], np.int64).reshape(-1, len(_WHOLE))
        own = real[:, [4, 5, 5, 6]].reshape(-1, 2, 2)
        shared = real[:, len(_READ):].reshape(len(real), common // 2, 2).transpose(0, 2, 1)
        return Vectors(real[:, :2], real[:, 2:4], whole[:, 0], whole[:, 1], own, shared, whole[:, 2], unit)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}: not vectors: {one_line(error)[:200]}") from error
