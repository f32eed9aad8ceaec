"""The output files of a command: checked before any work, and complete under their final names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.io.input_kind import check_input
from stab_ros.io.outputs import check_output, completed

JSON_NAME, CSV_NAME = "metrics.json", "metrics.csv"  # in the folder of the report


@dataclass(frozen=True)
class Writers:
    """Functions that write each kind of file; `report` writes into an existing folder and returns the page to open."""

    json: Callable[[Path], None]
    csv: Callable[[Path], None]
    report: Callable[[Path], Path]


@dataclass(frozen=True)
class ResultOutputs:
    """The requested files: JSON, CSV, and a report folder that holds both as well."""

    json: Path | None = None
    csv: Path | None = None
    report: Path | None = None

    def check(self, source: Path, force: bool) -> None:
        """Raises InputError for a missing `source`, or an output that cannot be written or exists (without `force`)."""
        check_input(source)
        for path, suffix in ((self.json, ".json"), (self.csv, ".csv")):
            if path is not None:
                check_output(path, suffix, source, force)
        if self.report is not None:
            _check_folder(self.report, force)

    def write(self, writers: Writers) -> dict[str, Path]:
        """Writes the files, and returns their paths by kind.

        Raises:
            InputError: a folder cannot be written into. WorkError: the disk is full.
        """
        made: dict[str, Path] = {}
        for kind, path, write in (("json", self.json, writers.json), ("csv", self.csv, writers.csv)):
            if path is not None:
                _write(path, write)
                made[kind] = path
        if self.report is not None:
            _make_folder(self.report)
            _write(self.report / JSON_NAME, writers.json)
            _write(self.report / CSV_NAME, writers.csv)
            made["report"] = writers.report(self.report)
        return made


def _write(path: Path, write: Callable[[Path], None]) -> None:
    with completed(path) as partial:
        write(partial)


def _check_folder(folder: Path, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, the report must have a folder")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise InputError(f"{folder}: is not empty, give --force to write into it or another name")
    if not folder.parent.is_dir():
        raise InputError(f"{folder}: cannot be made, {folder.parent} is not a folder; it must be one that exists")


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); its folder must be writable") from error
