"""Tables of ground control points."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.text import counted, one_line
from stab_ros.io.gcp_file_table import FORM, MOST_POINTS, Column, GcpTable, column_of
from stab_ros.io.length_units import check_units
from stab_ros.io.typed_table import COMMA_ADVICE, Row, cells_of, finite_at, number_in, separator_of

_KLT_IV_COLUMNS = ("east", "north", "up", "px", "py")
_KLT_IV_METRES = tuple(Column(what, unit="" if what in ("px", "py") else "m") for what in _KLT_IV_COLUMNS)
_DECIMAL_COMMAS = ";"  # the separator of a table whose commas are decimal ones
_BARE = ("px", "py", "east", "north", "up")
_THOUSAND = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")  # or a decimal comma
_COMMA = re.compile(r"[-+]?\d*,\d+")


def of_csv(path: Path, text: str) -> GcpTable:
    """The control points of a table.

    Args:
        path: for messages.
        text: its content.

    Raises:
        InputError: as `read_gcps`.
    """
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1)
             if line.strip() and not line.lstrip().startswith(("#", "%"))]
    if not lines:
        raise InputError(f"{path}: is empty, it must be a table of control points, {FORM}")
    if len(lines) > MOST_POINTS:
        raise InputError(f"{path}: holds more than {MOST_POINTS} points, there must not be so many")
    separator = separator_of(lines[0][1])
    rows = [(n, cells_of(path, n, line, separator, FORM)) for n, line in lines]
    if any(row[0].lower() == "frame" for _, row in rows[:3]):
        return _of_frames(path, rows)
    columns, rows = _columns(path, rows, separator)
    table = _table(path, columns, rows, separator)
    klt_iv = tuple(column.meaning for column in columns) == _KLT_IV_COLUMNS and "px]" in lines[0][1]
    return _of_klt_iv(table) if klt_iv else table


def _of_frames(path: Path, rows: list[Row]) -> GcpTable:
    """A table of KLT-IV with points of many frames, of which the first is taken."""
    starts = [i for i, (_, row) in enumerate(rows) if row[0].lower() == "frame"]
    end = starts[1] if len(starts) > 1 else len(rows)
    block = [(n, row) for n, row in rows[starts[0] + 1 : end] if any(row)]
    others = (f"{path}: points of {len(starts)} frames, the first is taken",) if len(starts) > 1 else ()
    table = _of_klt_iv(_table(path, _KLT_IV_METRES, block, ","))
    return replace(table, remarks=(*others, *table.remarks))


def _of_klt_iv(table: GcpTable) -> GcpTable:
    remark = "pixels of KLT-IV are counted from 1, so 1 is taken off"
    return replace(table, image_px=table.image_px - 1, remarks=(*table.remarks, remark))


def _columns(path: Path, rows: list[Row], separator: str) -> tuple[tuple[Column, ...], list[Row]]:
    """What each column holds, and the rows below the header."""
    first = rows[0][1]
    if sum(number_in(cell, _DECIMAL_COMMAS) is not None for cell in first) >= len(_BARE) - 1:
        if len(first) not in (5, 6):
            raise InputError(f"{path}: {counted(len(first), 'column')} without a header, the first line must be {FORM}"
                             f"{_comma_advice(first, separator)}")
        return tuple(Column(what) for what in ("name", *_BARE)[6 - len(first):]), rows
    columns = _by_headers(path, first)
    known = [column.meaning for column in columns if column.meaning]
    twice = next((what for what in known if known.count(what) > 1), None)
    if twice:
        names = " and ".join(one_line(column.header) for column in columns if column.meaning == twice)
        raise InputError(f"{path}: the columns {names} mean the same, the first line must be {FORM}")
    missing = [what for what in ("px", "py") if what not in known]
    if missing or not ({"east", "north"} <= set(known) or {"lat", "lon"} <= set(known)):
        found = one_line(",".join(first))[:120]
        what = "pixels" if missing else "places"
        raise InputError(f"{path}: no columns of {what} in {found!r}, the first line must be {FORM}")
    return columns, rows[1:]


def _by_headers(path: Path, headers: Sequence[str]) -> tuple[Column, ...]:
    try:
        return tuple(column_of(header) for header in headers)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _table(path: Path, columns: Sequence[Column], rows: list[Row], separator: str) -> GcpTable:
    at = {column.meaning: i for i, column in enumerate(columns) if column.meaning}
    geographic = "lat" in at and "lon" in at and "east" not in at
    wanted = ["px", "py", *(("lon", "lat") if geographic else ("east", "north")), *(["up"] if "up" in at else [])]
    separator = _separator_of_numbers(path, rows, [at[what] for what in wanted], separator)
    points = [(row, [_cell(path, n, row, at[what], separator, len(columns)) for what in wanted])
              for n, row in rows if any(row)]
    if not points:
        raise InputError(f"{path}: holds no point; below the first line there must be at least one")
    used = [columns[at[what]] for what in wanted]
    check_units(path, used[2:4], used[4] if "up" in at else None)
    numbers = np.array([values for _, values in points]) * [column.metres for column in used]
    places = numbers[:, 2:] if "up" in at else np.column_stack([numbers[:, 2:], np.full(len(points), np.nan)])
    named = at.get("name")
    names = tuple((row[named] if named is not None and named < len(row) else "") or f"G{i}"
                  for i, (row, _) in enumerate(points, 1))
    remarks = (*_converted(used), *_ignored(columns))
    return GcpTable(names, numbers[:, :2], places, geographic, None, remarks,
                    used[2].metres if used[2].unit else None)


def _separator_of_numbers(path: Path, rows: list[Row], at: Sequence[int], separator: str) -> str:
    """The separator as of `number_in`, where commas within quotes separate no columns."""
    cells = [(n, row[i]) for n, row in rows for i in at if i < len(row)]
    thousand = next(((n, cell) for n, cell in cells if _THOUSAND.fullmatch(cell)), None)
    decimal = next((cell for _, cell in cells if _COMMA.fullmatch(cell) and not _THOUSAND.fullmatch(cell)), None)
    if separator != "," or decimal is None:
        return separator
    if thousand is not None:
        raise InputError(f"{path}: line {thousand[0]}: {thousand[1]!r} may be a thousand or, as {decimal[:40]!r}, have "
                         "a decimal comma; numbers must have decimal points and no other commas")
    return _DECIMAL_COMMAS


def _converted(columns: Sequence[Column]) -> tuple[str, ...]:
    """Which columns were no metres."""
    named = ", ".join(one_line(column.header) for column in columns if column.metres != 1)
    return (f"{named} read in the unit that the header names, and made metres",) if named else ()


def _ignored(columns: Sequence[Column]) -> tuple[str, ...]:
    """Columns among which that of the heights may be, where no other is."""
    unknown = [one_line(column.header)[:40] for column in columns if not column.meaning and column.header]
    if any(column.meaning == "up" for column in columns) or not unknown:
        return ()
    return (f"there is no column of heights, as Z or height; not read: {', '.join(unknown)}",)


def _cell(path: Path, line: int, row: list[str], at: int, separator: str, columns: int) -> float:
    if len(row) > columns:
        raise InputError(f"{path}: line {line} has {counted(len(row), 'cell')} for {counted(columns, 'column')}"
                         f"{_comma_advice(row, separator)}")
    return finite_at(path, line, row, at, separator, FORM)


def _comma_advice(row: list[str], separator: str) -> str:
    decimal = separator == "," and len(row) >= 9
    return COMMA_ADVICE if decimal else ""
