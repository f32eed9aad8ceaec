"""Tables that people type: commas, semicolons or tabs between cells, decimal commas where these separate no columns."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import TypeAlias

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line

Row: TypeAlias = tuple[int, list[str]]  # number of the line, and its cells
COMMA_ADVICE = "; with decimal commas the columns must be separated by semicolons"


def separator_of(line: str) -> str:
    """The first of tab, semicolon and comma that the line has."""
    return next((mark for mark in "\t;" if mark in line), ",")


def cells_of(path: Path, line: int, text: str, separator: str, form: str) -> list[str]:
    """The cells of a line, without the space around them.

    Args:
        path: of the file, for the message.
        line: its number, for the message.
        text: the line.
        separator: of cells.
        form: what the file must be, for the message.

    Raises:
        InputError: the line is no row of a table.
    """
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=separator, skipinitialspace=True), [""])]
    except csv.Error as error:
        raise InputError(f"{path}: line {line} is no row of a table ({error}), it must be {form}") from error


def finite_at(path: Path, line: int, row: list[str], at: int, separator: str, form: str) -> float:
    """The number in the cell `at` of a row; the other arguments are as of `cells_of`.

    Raises:
        InputError: the row is shorter, or the cell holds no finite number.
    """
    value = number_in(row[at], separator) if at < len(row) else None
    if value is None or not math.isfinite(value):
        cell = one_line(row[at])[:40] if at < len(row) else ""
        raise InputError(f"{path}: line {line}: {cell!r} is no number, it must be a row {form}")
    return value


def number_in(cell: str, separator: str) -> float | None:
    """A number, with a decimal comma where commas separate no columns; None: the cell holds none."""
    text = cell.replace(",", ".") if separator != "," and cell.count(",") == 1 and "." not in cell else cell
    try:
        return float(text) if len(text) < 40 and "_" not in text else None
    except ValueError:
        return None
