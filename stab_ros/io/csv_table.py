"""A CSV file that grows row by row."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from stab_ros.core.errors import WorkError

if TYPE_CHECKING:
    from typing_extensions import Self


class CsvTable:
    """Writes rows of cells; each row is flushed. A context manager.

    Args:
        path: the file; an existing one is overwritten.

    Raises:
        WorkError: the file cannot be written (any method).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = path.open("w", encoding="utf-8", newline="")
        except OSError as error:
            raise self._broken(error) from error

    def rows(self, rows: Iterable[Iterable[str]]) -> None:
        """Appends rows."""
        try:
            self._file.writelines(",".join(cells) + "\n" for cells in rows)
            self._file.flush()
        except OSError as error:
            raise self._broken(error) from error

    def close(self) -> None:
        """Closes the file."""
        try:
            self._file.close()
        except OSError as error:
            raise self._broken(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _broken(self, error: OSError) -> WorkError:
        return WorkError(f"{self._path}: {error.strerror}")
