"""The writers of the files of an evaluation."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from stab_ros.core.progress import Progress
from stab_ros.evaluation.results import Evaluation
from stab_ros.jobs.evaluate import EvaluationJob
from stab_ros.jobs.evaluate_files import write_csv, write_json
from stab_ros.jobs.evaluate_streams import open_streams
from stab_ros.jobs.result_outputs import Writers


def writers_of(evaluation: Evaluation, job: EvaluationJob, progress: Progress) -> Writers:
    """The writers of JSON, CSV and report."""
    return Writers(partial(write_json, evaluation), partial(write_csv, evaluation),
                   partial(_write_report, evaluation, job, progress))


def _write_report(evaluation: Evaluation, job: EvaluationJob, progress: Progress, folder: Path) -> Path:
    from stab_ros.report import write_report  # here, as matplotlib takes a second to import, and only a report needs it

    with open_streams(job.source, job.image_topics, job.fps, job.clock) as streams:
        frames = [(picture.decoded for picture in stream.source.frames(job.limit)) for stream in streams]
        return write_report(evaluation, frames, folder, progress)
