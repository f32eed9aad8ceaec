"""Chosen columns of a CSV file with a header line, and its whole numbers."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from typing import IO


def csv_rows(
    file: IO[str], columns: Sequence[str], skipinitialspace: bool = False
) -> Iterator[tuple[int, list[str]]]:
    """Reads only these columns of a table with a header.

    Yields first (1, names of the columns that the header lacks); then for every row its last line number and its cells
    in the order of `columns`, "" where the row is too short.
    """
    table = csv.reader(file, strict=True, skipinitialspace=skipinitialspace)
    at = {name: column for column, name in enumerate(next(table, []))}
    yield 1, [name for name in columns if name not in at]
    chosen = [at[name] for name in columns]
    for cells in table:
        if cells:
            yield table.line_num, [cells[column] if column < len(cells) else "" for column in chosen]


def whole_of(name: str, cell: str) -> int:
    """The whole number in a cell of the column `name`.

    Raises:
        ValueError: it holds none, as where a spreadsheet has rounded a stamp; the message says what would be right.
    """
    try:
        return int(cell)
    except ValueError:
        raise ValueError(f"{name} is {cell[:40]!r}, it must be a whole number{_rounded(cell)}") from None


def _rounded(cell: str) -> str:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return ""
    return ", as it was written: a spreadsheet rounds long ones, unless it imports the column as text"
