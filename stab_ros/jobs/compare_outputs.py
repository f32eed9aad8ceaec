"""The writers of the files of a comparison."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from stab_ros.core.progress import Progress
from stab_ros.core.types import Frame, Homography, Image
from stab_ros.evaluation.comparison_results import Comparison
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.warp import warp
from stab_ros.io.source import open_source
from stab_ros.jobs.compare import ComparisonJob
from stab_ros.jobs.compare_files import write_csv, write_json
from stab_ros.jobs.result_outputs import Writers
from stab_ros.parameters.table import stabilizer_config


def writers_of(comparison: Comparison, job: ComparisonJob, progress: Progress) -> Writers:
    """The writers of JSON, CSV and report."""
    return Writers(partial(write_json, comparison), partial(write_csv, comparison),
                   partial(_write_report, comparison, job, progress))


def _write_report(comparison: Comparison, job: ComparisonJob, progress: Progress, folder: Path) -> Path:
    from stab_ros.report import write_comparison  # here, as matplotlib takes a second to import; only a report needs it

    with open_source(job.source, job.image_topic, job.fps, job.clock) as source:
        camera = source.camera() if job.values.get("use_camera_info") else None
        frames = (picture.decoded for picture in source.frames(job.limit))
        return write_comparison(comparison, frames, partial(_warped, job, camera), folder, progress)


def _warped(job: ComparisonJob, camera: Camera | None, method: str, frame: Frame, ref_H_cur: Homography) -> Image:
    """The frame warped to the reference, as the method's settings have it."""
    config = stabilizer_config(job.run_of(method).values)
    return warp(frame.image, ref_H_cur, frame.size, config.interpolation, camera)
