"""The tables of Zhang et al. 2023 on any video: transformation models (Table 2) and estimators (Tables 3 and 5).

Adjacent frames are matched as in section 2, the earlier one as the main frame; all models, or all estimators, get the
same matches (section 3.5). FS ("first select") is the size of the consensus set of RANSAC, FP ("final points") what the
Euclidean distance leaves of it, CMR = 100 FP / FS, and RMSE is Eq. 7 over the points that an estimator retains.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.gray import GreyRange, grey_range, to_gray
from stab_ros.core.kernels import Compiler, compile_kernels
from stab_ros.core.progress import Progress
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.core.types import BoolArray, Correspondences, Fit, Frame, Gray
from stab_ros.estimation import estimators
from stab_ros.evaluation.summary import Json
from stab_ros.io.outputs import completed
from stab_ros.io.regions import read_area
from stab_ros.io.source import open_source
from stab_ros.jobs.compare import ComparisonJob, checked_methods
from stab_ros.jobs.compare_text import aligned, written
from stab_ros.jobs.evaluate_files import write_tree
from stab_ros.jobs.result_outputs import ResultOutputs
from stab_ros.jobs.stabilize import expected
from stab_ros.methods import METHODS
from stab_ros.parameters.table import stabilizer_config
from stab_ros.tracking.settings import StabilizerConfig

METHOD, ESTIMATOR = "sift", "ed_ransac"
_MODELS = ("affine", "projective", "similarity")  # in the order of Table 2
_ESTIMATORS = ("ransac", "lo_ransac", "three_sigma", "ed_ransac")  # in the order of Table 3
_ED_PX = 0.2  # section 3.2
_RANSAC_PX = 3.0  # not given in the paper
_PAPER = {"projective": "perspective"}  # the term of the paper


@dataclass(frozen=True)
class Variant:
    """A row of a table: a combination of model, estimator and threshold."""

    name: str
    model: str
    estimator: str
    threshold_px: float


@dataclass(frozen=True)
class StudyRow:
    """The result of a variant over all pairs of frames that it could be fitted to.

    first_select, final_points: FS and FP, medians; FS None where the estimator has no consensus set.
    """

    name: str
    pairs: int
    first_select: int | None
    final_points: int | None
    cmr_percent: float | None
    rmse_median_px: float | None
    rmse_min_px: float | None
    rmse_max_px: float | None


@dataclass(frozen=True)
class Study:
    """A whole table. kind: models or estimators. pairs: number of adjacent pairs. matches: median over the pairs."""

    kind: str
    source: Path
    method: str
    frames: int
    pairs: int
    matches: int | None
    rows: tuple[StudyRow, ...]
    warnings: tuple[str, ...]


def study_method(names: Sequence[str] | None) -> str:
    """The method whose matches the study uses.

    Raises:
        InputError: not exactly one method, or an unknown one.
    """
    chosen = checked_methods([METHOD] if names is None else names)
    if len(chosen) != 1:
        raise InputError(f"--study: takes the matches of one method, --methods names {len(chosen)}")
    return chosen[0]


def run_study(kind: str, job: ComparisonJob, progress: Progress,
              compiling: Compiler = compile_kernels) -> Study:
    """Matches every frame with the previous frame, and fits all variants to the matches.

    compiling: compiles all kernels, before the first frame.

    Raises:
        InputError: an argument or the input is unusable.
    """
    config = stabilizer_config({**job.values, "method": job.methods[0]})
    variants, area = _variants(kind, job.values), read_area(job.values)
    fits: list[list[Fit | None]] = []
    matches: list[int] = []
    with open_source(job.source, job.image_topic, job.fps, job.clock) as source:
        total, frames = expected(source.count, job.limit), _Frames()
        compiling()
        pictures = (picture.decoded for picture in source.frames(job.limit))
        for before, current in frames.pairs(pictures):
            pairs = _matched(config, area.allowed(before.shape[::-1]), before, current)
            matches.append(len(pairs))
            fits.append([_fitted(pairs, variant) for variant in variants])
            progress(frames.count, total)
        warnings = tuple(source.warnings)
    rows = tuple(_row(variant, [one[index] for one in fits]) for index, variant in enumerate(variants))
    return Study(kind, job.source, job.methods[0], frames.count, len(fits),
                 statistics.median_low(matches) if matches else None, rows, warnings)


def _variants(kind: str, values: Mapping[str, Value]) -> list[Variant]:
    """The rows of the table; the parameters `model`, `estimator` and `threshold` set what the table does not vary."""
    estimator, model = str(values.get("estimator", ESTIMATOR)), str(values.get("model", "projective"))
    varied = [(name, name, estimator) for name in _MODELS] if kind == "models" else [
        (name, model, name) for name in _ESTIMATORS]
    return [Variant(name, of_model, by, float(values.get("threshold", _ED_PX if by == ESTIMATOR else _RANSAC_PX)))
            for name, of_model, by in varied]


class _Frames:
    """Pairs of adjacent gray frames; a frame that is undecodable or of another size is in no pair."""

    def __init__(self) -> None:
        self.count = 0

    def pairs(self, pictures: Iterator[object]) -> Iterator[tuple[Gray, Gray]]:
        before: Gray | None = None
        shown: GreyRange | None = None
        for decoded in pictures:
            self.count += 1
            current = None
            if isinstance(decoded, Frame):
                shown = shown or grey_range(decoded)
                current = to_gray(decoded, shown).copy()
            if before is not None and current is not None and before.shape == current.shape:
                yield before, current
            before = current


def _matched(config: StabilizerConfig, allowed: BoolArray, before: Gray, current: Gray) -> Correspondences:
    kind = METHODS[config.method]
    method = kind(before, allowed, config.method_config)
    return method.match(current, np.eye(3), np.ones(len(method.reference_px)))


def _fitted(pairs: Correspondences, variant: Variant) -> Fit | None:
    return estimators.fit(pairs, variant.model, variant.estimator, variant.threshold_px, np.eye(3))


def _row(variant: Variant, fits: Sequence[Fit | None]) -> StudyRow:
    found = [fit for fit in fits if fit is not None]
    name = _PAPER.get(variant.name, variant.name)
    if not found:
        return StudyRow(name, 0, None, None, None, None, None, None)
    finals = [int(fit.inlier.sum()) for fit in found]
    sizes = [fit.consensus for fit in found]
    known = [size for size in sizes if size is not None]
    shares = [100 * final / size for final, size in zip(finals, sizes, strict=True) if size]
    rmse_px = [fit.rmse_px for fit in found]
    return StudyRow(name, len(found), statistics.median_low(known) if known else None,
                    statistics.median_low(finals), statistics.median(shares) if shares else None,
                    statistics.median(rmse_px), min(rmse_px), max(rmse_px))


def study_json(study: Study) -> Json:
    """`compare --study ... --json`."""
    return {"study": study.kind, "source": study.source.name, "method": study.method, "frames": study.frames,
            "pairs": study.pairs, "matches": study.matches, "warnings": list(study.warnings),
            study.kind: {row.name: {key: value for key, value in asdict(row).items() if key != "name"}
                         for row in study.rows}}


def check_outputs(job: ComparisonJob, outputs: ResultOutputs) -> None:
    """Raises InputError for an option that a study does not support."""
    for option, path in (("--truth", job.truth), ("--csv", outputs.csv), ("--report", outputs.report)):
        if path is not None:
            raise InputError(f"{option} {path}: does not go with --study, which prints a table and writes --json alone")


def write_study(study: Study, path: Path) -> None:
    """Raises WorkError where the file cannot be written."""
    with completed(path) as partial:
        write_tree(study_json(study), partial)


def study_text(study: Study) -> str:
    """The table in the layout of the paper."""
    of_models = study.kind == "models"
    head = ["", "FS", "FP", "CMR %", "RMSE px", "pairs"] if of_models else [
        "", "max px", "min px", "median px", "pairs"]
    rows = [_models_row(row) if of_models else _estimators_row(row) for row in study.rows]
    what = "medians" if of_models else "RMSE of the retained points"
    return "\n".join([*aligned([head, *rows]), f"{what} over {counted(study.pairs, 'pair')} of adjacent frames, "
                      f"{study.method}, {counted(study.matches or 0, 'match', 'matches')} (median)"])


def _models_row(row: StudyRow) -> list[str]:
    return [row.name, *map(written, (row.first_select, row.final_points, row.cmr_percent, row.rmse_median_px)),
            str(row.pairs)]


def _estimators_row(row: StudyRow) -> list[str]:
    return [row.name, *map(written, (row.rmse_max_px, row.rmse_min_px, row.rmse_median_px)), str(row.pairs)]
