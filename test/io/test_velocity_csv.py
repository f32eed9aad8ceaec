"""Tables of velocity vectors."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from velocities import random_vectors

from stab_ros.core.errors import InputError
from stab_ros.io.velocity_csv import VelocityWriter, read_velocities
from stab_ros.velocimetry.speeds import joined, sigma_speed_m_s
from stab_ros.velocimetry.vectors import Unit, Vectors

_FIELDS = ("start_m", "end_m", "start_ns", "end_ns", "covariance", "shared", "track_id")


def _written(path: Path, *parts: Vectors, unit: Unit = "m") -> Path:
    with VelocityWriter(path, unit) as writer:
        for part in parts:
            writer.write(part)
    return path


@pytest.mark.parametrize(("shared", "unit"), [(0, "m"), (3, "m"), (2, "px")])
def test_what_is_written_is_read_exactly(tmp_path: Path, shared: int, unit: Unit) -> None:
    parts = [random_vectors(7, shared, unit, seed, seed * 10**9) for seed in (1, 2)]
    read, whole = read_velocities(_written(tmp_path / "V.csv", *parts, unit=unit)), joined(parts)
    assert read.unit == unit
    for name in _FIELDS:
        found, true = getattr(read, name), getattr(whole, name)
        assert found.dtype == true.dtype
        np.testing.assert_array_equal(found, true)


def test_columns_of_klt_iv_come_first(tmp_path: Path) -> None:
    vectors = random_vectors(5)
    with _written(tmp_path / "V.csv", vectors).open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:5] == ["x_start_m", "y_start_m", "vx_m_s", "vy_m_s", "speed_m_s"]
    v = vectors.velocity_m_s
    np.testing.assert_array_equal(np.array([row[:5] for row in rows], float),
                                  np.column_stack([vectors.start_m, v, np.hypot(*v.T)]))


def test_a_table_without_vectors(tmp_path: Path) -> None:
    read = read_velocities(_written(tmp_path / "V.csv", random_vectors(0, 0)))
    assert (len(read), read.unit, read.shared.shape) == (0, "m", (0, 2, 0))


def test_vectors_of_other_units_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError), VelocityWriter(tmp_path / "V.csv") as writer:
        writer.write(random_vectors(3, unit="px"))
    with VelocityWriter(tmp_path / "V.csv") as writer:
        writer.write(random_vectors(3, 2))
        with pytest.raises(ValueError):
            writer.write(random_vectors(3, 4))


@pytest.mark.parametrize(("text", "what"), [
    ("", "no column"),
    ("x,y\n1,2\n", "no column x_start_m"),
    ("\0\0", "no column"),
    ("x_start_m;y_start_m\n1;2\n", "separated by commas"),
    (b"\xff\xfe\xff", "not a table"),
])
def test_other_files_are_named(tmp_path: Path, text: str | bytes, what: str) -> None:
    path = tmp_path / "V.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError, match=what):
        read_velocities(path)


@pytest.mark.parametrize(("column", "cell", "what"), [
    ("var_vx", "nan", "line 3 is not a row"),
    ("x_end_m", "abc", "line 3 is not a row"),
    ("end_ns", "1", "must end after its start"),
    ("vx_m_s", "nan", "line 3 is not a row"),
    ("vy_m_s", "0.9", "line 3: vx and vy are not those of start, end and stamps"),
    ("track_id", str(2**70), "not vectors"),
    ("start_ns", "1.79592E+18", "line 3 is not a row of velocities: start_ns is '1.79592E.18', it must be a whole "
     "number, as it was written: a spreadsheet rounds"),
    ("end_ns", "1,79592E+18", "line 3"),
])
def test_damaged_cells_are_named(tmp_path: Path, column: str, cell: str, what: str) -> None:
    path = _written(tmp_path / "V.csv", random_vectors(4))
    rows = [line.split(",") for line in path.read_text().splitlines()]
    rows[2][rows[0].index(column)] = cell
    path.write_text("\n".join(map(",".join, rows)))
    with pytest.raises(InputError, match=what):
        read_velocities(path)


def test_sigma_of_speed_is_that_along_the_flow() -> None:
    vectors = random_vectors(1, 1)
    draws = np.random.default_rng(0).multivariate_normal(vectors.velocity_m_s[0], vectors.total_covariance[0], 200_000)
    spread = float(np.hypot(*draws.T).std())
    assert float(sigma_speed_m_s(vectors)[0]) == pytest.approx(spread, rel=0.02)
