"""What writes an evaluation."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from stab_ros.jobs.evaluate import Evaluation, EvaluationJob
from stab_ros.jobs.evaluate_files import write_csv, write_json
from stab_ros.jobs.result_outputs import Writers
from stab_ros.jobs.stabilize import Progress


def writers_of(evaluation: Evaluation, job: EvaluationJob, progress: Progress) -> Writers:
    """Its JSON, CSV and report."""
    return Writers(partial(write_json, evaluation), partial(write_csv, evaluation),
                   partial(_write_report, evaluation, job, progress))


def _write_report(evaluation: Evaluation, job: EvaluationJob, progress: Progress, folder: Path) -> Path:
    from stab_ros.report import write_report  # matplotlib takes a second, which only a report is to cost

    return write_report(evaluation, job, folder, progress)
