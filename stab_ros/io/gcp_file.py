"""Files of ground control points: CSV tables under many headers, those of KLT-IV, and GeoJSON."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.io.gcp_file_csv import of_csv
from stab_ros.io.gcp_file_geojson import of_geojson
from stab_ros.io.gcp_file_table import FORM, GcpTable

_MOST_BYTES = 2**22


def read_gcps(path: Path) -> GcpTable:
    """Reads a file of control points.

    Args:
        path: a .csv or .txt (columns by their header or, without one, x, y, X, Y, Z with or without a name before them;
            separated by commas, semicolons or tabs, with decimal commas where they separate no columns), a table of
            KLT-IV, or a .geojson of points with x and y among their properties.

    Raises:
        InputError: the file or a column is missing, a cell is no number, or two points have one name.
    """
    text = _text(path)
    table = of_geojson(path, text) if text.lstrip().startswith("{") else of_csv(path, text)
    twice = next((name for name, count in Counter(table.names).items() if count > 1), None)
    if twice is not None:
        raise InputError(f"{path}: has {one_line(twice)} twice, every point must have a name of its own")
    return table


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; it must be a table of control points, {FORM}") from error
    except ValueError as error:
        raise InputError(f"{one_line(path)}: is no possible name of a file") from error
    if len(data) > _MOST_BYTES:
        raise InputError(f"{path}: has more than {_MOST_BYTES} bytes, a table of control points is smaller")
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text, it must be a table of control points, {FORM}") from error
    return text
