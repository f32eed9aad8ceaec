"""Files of a surveyed cross-section: [X, Y, Z or depth], or [chainage, Z or depth], under many headers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.text import counted, one_line
from stab_ros.core.types import FloatArray
from stab_ros.io.column_qualifiers import qualifier_of
from stab_ros.io.length_units import FEET, LENGTH_PATTERN, LENGTHS_TEXT, check_units, metres_of
from stab_ros.io.text_file import read_text
from stab_ros.io.typed_table import COMMA_ADVICE, Row, cells_of, finite_at, number_in, separator_of

Heights: TypeAlias = Literal["elevation", "depth", "unknown"]
FORM = "X,Y,Z or X,Y,depth or chainage,Z or chainage,depth, in metres or with (ft)"
MOST_POINTS = 100_000
_MEANINGS = {  # header in small letters, without its unit: what the column holds
    **dict.fromkeys(("x", "e", "east", "easting", "x_map", "map_x", "xcoord", "x_coord", "xcoords"), "east"),
    **dict.fromkeys(("y", "n", "north", "northing", "y_map", "map_y", "ycoord", "y_coord", "ycoords"), "north"),
    **dict.fromkeys(("chainage", "station", "stationing", "distance", "dist", "offset", "s", "d", "location",
                     "cross_distance", "relative_distance", "tagline"), "chainage"),
    **dict.fromkeys(("z", "elevation", "elev", "ele", "bed", "bed_elevation", "bed_level", "z_bed", "bed_z", "level",
                     "altitude", "height", "zcoord", "z_coord", "zcoords", "true_bed_elevation"), "elevation"),
    **dict.fromkeys(("depth", "water_depth", "depths", "vertical_depth"), "depth"),
    **dict.fromkeys(("h", "z/depth", "z_depth", "z_or_depth"), "unknown"),
    **dict.fromkeys(("lat", "latitude", "lon", "lng", "longitude"), "geographic"),
}
_HEIGHTS: tuple[Heights, ...] = ("elevation", "depth", "unknown")
_UNIT = re.compile(rf"(.*?)[ _]*(?:[\[(] *(.*?) *[\])]|(?<=[ _])({LENGTH_PATTERN}))?", re.DOTALL | re.IGNORECASE)
_LONGEST = 100  # header, where longer ones have no meaning


@dataclass(frozen=True, eq=False)
class SectionTable:
    """What a file says of a cross-section, in metres.

    Attributes:
        position_m: (N, 2), east and north, metres where the file names a unit, else in that of the reference system;
            None: the file has distances along the section.
        chainage_m: (N,); None: the file has places.
        height_m: (N,), as `heights` says.
        heights: elevations of the bed, depths of the water, or "unknown" where the header does not tell.
        remarks: how it was read, where that is not plain: one line each.
        unit_m: metres of the unit that the file names for places, which are metres here; None: it names none.
    """

    position_m: FloatArray | None
    chainage_m: FloatArray | None
    height_m: FloatArray
    heights: Heights
    remarks: tuple[str, ...] = ()
    unit_m: float | None = None


@dataclass(frozen=True)
class _Column:
    """meaning: one of _MEANINGS; "": none. metres: of one unit. unit: as named; "": none is. header: as written."""

    meaning: str
    metres: float
    unit: str
    header: str


def read_section(path: Path) -> SectionTable:
    """Reads a cross-section.

    Args:
        path: a .csv or .txt, its columns by their header or, without one, X, Y, Z or chainage, Z; separated by commas,
            semicolons or tabs, with decimal commas where they separate no columns. Units stand in the header, as
            `Z (ft)` or `depth_m`; without one they are metres.

    Raises:
        InputError: the file or a column is missing, or a cell is no number.
    """
    what = f"a table of a cross-section, {FORM}"
    lines = [(n, line) for n, line in enumerate(read_text(path, what).splitlines(), 1)
             if line.strip(" \t\0;,") and not line.lstrip().startswith(("#", "%"))]
    if not lines:
        raise InputError(f"{path}: is empty, it must be {what}")
    if len(lines) > MOST_POINTS:
        raise InputError(f"{path}: holds more than {MOST_POINTS} points, a cross-section must not have so many")
    separator = separator_of(lines[0][1])
    rows = [(n, cells_of(path, n, line, separator, FORM)) for n, line in lines]
    columns, rows = _columns(path, rows, separator)
    return _table(path, columns, rows, separator)


def _columns(path: Path, rows: list[Row], separator: str) -> tuple[list[_Column], list[Row]]:
    """What each column holds, and the rows below the header."""
    first = rows[0][1]
    if all(number_in(cell, separator) is not None for cell in first):
        names = {2: ("chainage", "unknown"), 3: ("east", "north", "unknown")}.get(len(first))
        if names is None:
            raise InputError(f"{path}: {counted(len(first), 'column')} without a header, the first line must be {FORM}")
        return [_Column(name, 1.0, "", name) for name in names], rows
    columns = [_column(path, cell) for cell in first]
    known = [column.meaning for column in columns if column.meaning]
    found = one_line(separator.join(first))[:120]
    if "geographic" in known:
        raise InputError(f"{path}: has latitudes and longitudes in {found!r}, a section must be in the metres of the "
                         "map, or have chainages")
    for group in (("east",), ("north",), ("chainage",), _HEIGHTS):
        if sum(name in group for name in known) > 1:
            named = " and ".join(one_line(column.header) for column in columns if column.meaning in group)
            raise InputError(f"{path}: {named} are two columns for one thing, the first line must be {FORM}")
    if not ({"east", "north"} <= set(known) or "chainage" in known) or not set(_HEIGHTS) & set(known):
        raise InputError(f"{path}: no columns of a cross-section in {found!r}, the first line must be {FORM}")
    return columns, rows[1:]


def _column(path: Path, header: str) -> _Column:
    text = " ".join(header.split()).strip('" ')
    parts = _UNIT.fullmatch(text) if len(text) < _LONGEST else None
    bare, beside = (parts[1], qualifier_of(parts[2] or parts[3] or "")) if parts else (text, qualifier_of(""))
    meaning = _MEANINGS.get(bare.lower().strip().replace(" ", "_"), "")
    if not meaning:
        return _Column("", 1.0, "", header)
    if beside.axis and beside.axis != {"elevation": "up"}.get(meaning, meaning):
        raise InputError(f"{path}: the column {one_line(header)[:60]!r} is named for two axes, it must be for one")
    metres = metres_of(beside.unit) if beside.unit else 1.0
    if metres is None:
        raise InputError(f"{path}: the column {one_line(header)[:60]!r} is in a unit that is not known, it must be "
                         f"{LENGTHS_TEXT}")
    return _Column(meaning, metres, beside.unit, header)


def _table(path: Path, columns: list[_Column], rows: list[Row], separator: str) -> SectionTable:
    at = {column.meaning: i for i, column in enumerate(columns) if column.meaning}
    places = ["east", "north"] if {"east", "north"} <= set(at) else ["chainage"]
    heights = next(kind for kind in _HEIGHTS if kind in at)
    wanted = [at[name] for name in (*places, heights)]
    values = [[_cell(path, n, row, i, separator, len(columns)) * columns[i].metres for i in wanted] for n, row in rows]
    if not values:
        raise InputError(f"{path}: holds no point; below the first line there must be at least three")
    used = [columns[i] for i in wanted]
    check_units(path, used[:-1], used[-1])
    numbers, repeated = _once(np.array(values))
    place, chained = numbers[:, :-1], places == ["chainage"]
    return SectionTable(None if chained else place, place[:, 0] if chained else None, numbers[:, -1], heights,
                        (*_remarks(path, used), *_said(path, repeated)), used[0].metres if used[0].unit else None)


def _once(points: FloatArray) -> tuple[FloatArray, int]:
    """Points (N, d) without those that stand further above in all digits, and how many these are."""
    _, first = np.unique(points, axis=0, return_index=True)
    return points[np.sort(first)], len(points) - len(first)


def _said(path: Path, repeated: int) -> tuple[str, ...]:
    rows = counted(repeated, "row repeats", "rows repeat")
    return (f"{path}: {rows} a point, which counts once",) if repeated else ()


def _remarks(path: Path, columns: list[_Column]) -> tuple[str, ...]:
    feet = [one_line(column.header) for column in columns if column.metres in FEET]
    return (f"{path}: {', '.join(feet)} read as feet, and made metres",) if feet else ()


def _cell(path: Path, line: int, row: list[str], at: int, separator: str, columns: int) -> float:
    if len(row) > columns and any(row[columns:]):
        advice = COMMA_ADVICE if separator == "," else ""
        raise InputError(f"{path}: line {line} has {len(row)} cells for {columns} columns{advice}")
    return finite_at(path, line, row, at, separator, FORM)
