"""How still the stabilised flight stands: what the evaluator node told live, and what the command finds in the bag."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from stab_ros.core.config import Value
from stab_ros.core.errors import WorkError
from stab_ros.core.frame_metrics import UNITS
from stab_ros.demo.replay import METRICS, STABILIZED
from stab_ros.demo.result import status_values
from stab_ros.io.bag import open_bag
from stab_ros.io.evaluation import Evaluation, EvaluationJob, TopicEvaluation, evaluate
from stab_ros.io.evaluation_outputs import writers_of
from stab_ros.io.messages import read_stamp
from stab_ros.io.result_outputs import ResultOutputs
from stab_ros.io.text import number

_SHOWN = ("displacement_reference_px", "displacement_previous_px", "rmse_reference_px", "rmse_previous_px",
          "velocity_error_m_s")


@dataclass(frozen=True)
class Judgement:
    """live_difference: the largest between live and command, over all measures of all frames."""

    evaluation: Evaluation
    live_difference: float
    report: Path

    def text(self) -> str:
        """A few lines to read."""
        raw, steady = self.evaluation.topics
        title = f"{'how still it stands, median':<32}{'as recorded':>14}{'stabilised':>14}"
        rows = [f"{name:<32}{_median(raw, name):>14}{_median(steady, name):>14}" for name in _SHOWN]
        differ = f"live and from the bag, the measures differ by {self.live_difference:g} at most"
        return "\n".join([title, *rows, differ])


def judge(bag: Path, folder: Path, values: Mapping[str, Value]) -> Judgement:
    """Evaluates the bag that was recorded, compares, and writes the report into `folder`.

    Raises:
        WorkError: a frame has no measures from the live evaluator.
    """
    job = EvaluationJob(bag, values)
    with tqdm(unit=" frames", desc="evaluate", disable=None) as bar:

        def show(done: int, total: int | None) -> None:
            bar.total = total
            bar.update(done - bar.n)

        evaluation = evaluate(job, show)
    writers = writers_of(evaluation, job, lambda _done, _total: None)
    report = ResultOutputs(report=folder).write(writers)["report"]
    return Judgement(evaluation, _difference(bag, evaluation), report)


def _difference(bag: Path, evaluation: Evaluation) -> float:
    with open_bag(bag) as reader:
        live = {read_stamp(message.data): status_values(message.data) for message in reader.messages({METRICS})}
    (steady,) = (topic for topic in evaluation.topics if topic.topic == STABILIZED)
    missing = [row.frame for row in steady.rows if row.stamp_ns not in live]
    if missing:
        raise WorkError(f"{bag}: the evaluator gave no measures of frame {missing[0]}")
    return max(_apart(live[row.stamp_ns].get(name, ""), number(row[name])) for row in steady.rows for name in UNITS)


def _apart(one: str, other: str) -> float:
    """How far two numbers differ; a missing one differs from any."""
    if one == other:
        return 0.0
    return abs(float(one) - float(other)) if one and other else math.inf


def _median(topic: TopicEvaluation, name: str) -> str:
    summary = topic.summary(name)
    return "-" if summary is None else f"{summary.median:.3f}"
