"""Where an evaluation is written to: refused before any work if it cannot be, and complete under its final name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.io.evaluation import Evaluation, EvaluationJob, Progress
from stab_ros.io.evaluation_files import write_csv, write_json
from stab_ros.io.outputs import check_output, completed

JSON_NAME, CSV_NAME = "metrics.json", "metrics.csv"  # in the folder of the report


@dataclass(frozen=True)
class EvaluationOutputs:
    """Any of: a JSON file, a CSV file, and a folder with both and the report."""

    json: Path | None = None
    csv: Path | None = None
    report: Path | None = None

    def check(self, source: Path, force: bool) -> None:
        """Raises InputError for what cannot be written, or exists (without `force`)."""
        for path, suffix in ((self.json, ".json"), (self.csv, ".csv")):
            if path is not None:
                check_output(path, suffix, source, force)
        if self.report is not None:
            _check_folder(self.report, force)

    def write(self, evaluation: Evaluation, job: EvaluationJob, progress: Progress) -> dict[str, Path]:
        """What was written, by kind.

        Raises:
            InputError: a folder cannot be written into. WorkError: the disk is full.
        """
        made: dict[str, Path] = {}
        for kind, path, write in (("json", self.json, write_json), ("csv", self.csv, write_csv)):
            if path is not None:
                with completed(path) as partial:
                    write(evaluation, partial)
                made[kind] = path
        if self.report is not None:
            made["report"] = _write_report(evaluation, job, self.report, progress)
        return made


def _check_folder(folder: Path, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, the report must have a folder")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise InputError(f"{folder}: is not empty, give --force to write into it or another name")
    if not folder.parent.is_dir():
        raise InputError(f"{folder}: cannot be made, {folder.parent} is not a folder; it must be one that exists")


def _write_report(evaluation: Evaluation, job: EvaluationJob, folder: Path, progress: Progress) -> Path:
    from stab_ros.report import write_report  # matplotlib takes a second, which only a report is to cost

    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); its folder must be writable") from error
    for name, write in ((JSON_NAME, write_json), (CSV_NAME, write_csv)):
        with completed(folder / name) as partial:
            write(evaluation, partial)
    return write_report(evaluation, job, folder, progress)
