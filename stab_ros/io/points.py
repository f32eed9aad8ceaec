"""Points from the user, in reference pixels: a CSV `name,x,y`, or JSON [[x, y], ...]."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.text import one_line
from stab_ros.core.types import NO_POINTS, FloatArray
from stab_ros.evaluation.settings import NamedPoint
from stab_ros.io.csv_rows import csv_rows

COLUMNS = ("name", "x", "y")
_MAX_POINTS = 100_000
_MAX_TEXT = 2**22  # characters of JSON: so many points in full precision


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
    if len(text) > _MAX_TEXT:
        raise InputError(f"manual_points: {len(text)} characters, it must have at most {_MAX_TEXT}")
    try:
        points = np.array(json.loads(text), dtype=np.float64)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"manual_points: it must be JSON [[x, y], ...] ({error})") from error
    if points.ndim == 1 and points.size in range(4, _MAX_TEXT, 2):  # [x, y, x, y, ...]; of nested ones rcl keeps a row
        points = points.reshape(-1, 2)
    if points.ndim != 2 or points.shape[1] != 2 or not len(points):
        raise InputError(f"manual_points: {text[:80]!r} is no list of points, it must be JSON [[x, y], ...]")
    if not np.isfinite(points).all():
        raise InputError(f"manual_points: {text[:80]!r} must hold finite pixels")
    return points


def read_points(path: Path) -> tuple[NamedPoint, ...]:
    """Reads named points.

    Args:
        path: a CSV file with the columns name, x, y, in pixels of the reference; further columns are ignored.

    Returns:
        Name, x and y of each row.

    Raises:
        InputError: the file, a column or all rows are missing, a name occurs twice, or a cell is not a number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv_rows(file, COLUMNS, skipinitialspace=True)
            missing = next(rows)[1]
            if missing:
                raise InputError(f"{path}: no column {missing[0]}; the first line must be {','.join(COLUMNS)}, "
                                 "separated by commas")
            points = tuple(_point(path, line, cells) for line, cells in islice(rows, _MAX_POINTS + 1))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; it must be a table of points, {','.join(COLUMNS)}") from error
    except (ValueError, csv.Error) as error:  # ValueError: not UTF-8, or no possible name of a file
        raise InputError(f"{path}: not a table of points, it must be a .csv with {','.join(COLUMNS)}") from error
    _check(path, [name for name, _, _ in points])
    return points


def _point(path: Path, line: int, cells: Sequence[str]) -> NamedPoint:
    name = cells[0].strip()
    try:
        x, y = float(cells[1]), float(cells[2])
    except ValueError:
        x = y = math.nan
    if not name or not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"{path}: line {line} is no point, it must be a name and two numbers, as in V1,320,240")
    return name, x, y


def _check(path: Path, names: list[str]) -> None:
    if not names:
        raise InputError(f"{path}: holds no point; below {','.join(COLUMNS)} there must be at least one")
    if len(names) > _MAX_POINTS:
        raise InputError(f"{path}: holds more than {_MAX_POINTS} points, there must not be so many")
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise InputError(f"{path}: has {one_line(twice)} twice, every point must have a name of its own")
