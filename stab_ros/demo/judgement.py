"""Residual motion of the stabilised flight: from the live evaluator node, and from the command on the bag."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.text import number
from stab_ros.demo.replay import METRICS, RAW, STABILIZED
from stab_ros.demo.stages import bar
from stab_ros.evaluation.frame_metrics import UNITS
from stab_ros.evaluation.results import Evaluation, TopicEvaluation
from stab_ros.io.bag import open_bag
from stab_ros.io.cdr import read_stamp
from stab_ros.io.diagnostics_message import read_values
from stab_ros.jobs.evaluate import EvaluationJob, evaluate
from stab_ros.jobs.evaluate_outputs import writers_of
from stab_ros.jobs.result_outputs import ResultOutputs

_SHOWN = ("displacement_reference_px", "displacement_previous_px", "rmse_reference_px", "rmse_previous_px",
          "velocity_error_m_s")


@dataclass(frozen=True)
class Judgement:
    """The evaluation. live_difference: the largest from any live metric. unmeasured: frames without live metrics."""

    evaluation: Evaluation
    live_difference: float
    unmeasured: Sequence[int]
    report: Path

    def text(self) -> str:
        """The medians as a table."""
        raw, steady = (_of(self.evaluation, name) for name in (RAW, STABILIZED))
        title = f"{'how still it stands, median':<32}{'as recorded':>14}{'stabilised':>14}"
        rows = (f"{name:<32}{_median(raw, name):>14}{_median(steady, name):>14}" for name in _SHOWN)
        return "\n".join([title, *rows])


def judge(bag: Path, folder: Path, values: Mapping[str, Value]) -> Judgement:
    """Evaluates the recorded bag, compares it with the live metrics, and writes the report into `folder`.

    Raises:
        InputError: the bag holds nothing to evaluate. WorkError: the report cannot be written.
    """
    job = EvaluationJob(bag, values)
    with bar("evaluate") as progress:
        evaluation = evaluate(job, progress)
    writers = writers_of(evaluation, job, lambda _done, _total: None)
    report = ResultOutputs(report=folder).write(writers)["report"]
    return Judgement(evaluation, *_live(bag, _of(evaluation, STABILIZED)), report)


def _of(evaluation: Evaluation, name: str) -> TopicEvaluation:
    found = [topic for topic in evaluation.topics if topic.topic == name]
    if not found:
        raise InputError(f"{evaluation.source}: holds no pictures of {name}, so how still they stand cannot be told")
    return found[0]


def _live(bag: Path, steady: TopicEvaluation) -> tuple[float, list[int]]:
    """The largest difference of any metric, and the frames without live metrics."""
    with open_bag(bag) as reader:
        live = {read_stamp(message.data): read_values(message.data)
                for message in reader.messages({METRICS} & set(reader.topics))}
    both = [(live[row.stamp_ns], row) for row in steady.rows if row.stamp_ns in live]
    differences = (_apart(values.get(name, ""), number(row[name])) for values, row in both for name in UNITS)
    return max(differences, default=0.0), [row.frame for row in steady.rows if row.stamp_ns not in live]


def _apart(one: str, other: str) -> float:
    """The difference of two numbers; infinite if only one of them exists."""
    if one == other:
        return 0.0
    return abs(float(one) - float(other)) if one and other else math.inf


def _median(topic: TopicEvaluation, name: str) -> str:
    summary = topic.summary(name)
    return "-" if summary is None else f"{summary.median:.3f}"
