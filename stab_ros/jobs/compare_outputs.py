"""What writes a comparison."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from stab_ros.jobs.compare import Comparison, ComparisonJob
from stab_ros.jobs.compare_files import write_csv, write_json
from stab_ros.jobs.result_outputs import Writers
from stab_ros.jobs.stabilize import Progress


def writers_of(comparison: Comparison, job: ComparisonJob, progress: Progress) -> Writers:
    """Its JSON, CSV and report."""
    return Writers(partial(write_json, comparison), partial(write_csv, comparison),
                   partial(_write_report, comparison, job, progress))


def _write_report(comparison: Comparison, job: ComparisonJob, progress: Progress, folder: Path) -> Path:
    from stab_ros.report import write_comparison  # matplotlib takes a second, which only a report is to cost

    return write_comparison(comparison, job, folder, progress)
