"""Points that the user names, in reference pixels: a CSV `name,x,y`, or JSON [[x, y], ...]."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stab_ros.core.config import Value
from stab_ros.core.errors import InputError
from stab_ros.core.types import NO_POINTS, FloatArray

COLUMNS = ("name", "x", "y")
NamedPoint = tuple[str, float, float]


def read_tracking_points(values: Mapping[str, Value]) -> FloatArray:
    """The points of the parameters `points_file` and `manual_points`, (n, 2) float64; none without either.

    Raises:
        InputError: both are given, or one is no list of points.
    """
    file, text = str(values.get("points_file", "")), str(values.get("manual_points", "")).strip()
    if file and text:
        raise InputError("points_file and manual_points are both given, it must be one of them")
    if file:
        return np.array([(x, y) for _, x, y in read_points(Path(file))])
    return _listed(text) if text else NO_POINTS


def _listed(text: str) -> FloatArray:
    try:
        points = np.array(json.loads(text), dtype=np.float64)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"manual_points: it must be JSON [[x, y], ...] ({error})") from error
    if points.ndim != 2 or points.shape[1] != 2 or not len(points):
        raise InputError(f"manual_points: {text[:80]!r} is no list of points, it must be JSON [[x, y], ...]")
    if not np.isfinite(points).all():
        raise InputError(f"manual_points: {text[:80]!r} must hold finite pixels")
    return points


def read_points(path: Path) -> tuple[NamedPoint, ...]:
    """Name, x and y of every row; further columns do not matter.

    Raises:
        InputError: no such file, no such columns, no row, a name twice or a cell that is not a number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.DictReader(file, strict=True, skipinitialspace=True)
            missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
            if missing:
                raise InputError(f"{path}: no column {missing[0]}; the first line must be {','.join(COLUMNS)}")
            points = tuple(_point(path, table.line_num, cells) for cells in table)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; it must be a table of points, {','.join(COLUMNS)}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a table of points, it must be a .csv with {','.join(COLUMNS)}") from error
    _check(path, [name for name, _, _ in points])
    return points


def _point(path: Path, line: int, cells: Mapping[str, str | None]) -> NamedPoint:
    name = (cells["name"] or "").strip()
    try:
        x, y = float(cells["x"] or ""), float(cells["y"] or "")
    except ValueError:
        x = y = math.nan
    if not name or not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"{path}: line {line} is no point, it must be a name and two numbers, as in V1,320,240")
    return name, x, y


def _check(path: Path, names: list[str]) -> None:
    if not names:
        raise InputError(f"{path}: holds no point; below {','.join(COLUMNS)} there must be at least one")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"{path}: has {twice[0]} twice, every point must have a name of its own")
