"""An evaluation as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from stab_ros.evaluation.frame_metrics import UNITS, Outcome
from stab_ros.evaluation.results import Evaluation, TopicEvaluation
from stab_ros.evaluation.summary import findings_of, unrest_px
from stab_ros.metrics.statistics import Summary, summarize

_WORST = 5  # findings that are shown


def as_text(evaluation: Evaluation) -> str:
    """The metrics of all streams side by side, then frames, velocity field, points and findings of each."""
    blocks = [_metrics_table(evaluation.topics)]
    for topic in evaluation.topics:
        blocks += [_frames_line(topic), *_svf_table(topic), *_points_table(topic), *_finding_lines(topic)]
    return "\n\n".join(blocks)


def _metrics_table(topics: Sequence[TopicEvaluation]) -> str:
    lines = [f"{'':<28}" + "".join(f"{_short(topic.topic):>36}" for topic in topics),
             f"{'':<28}" + f"{'median':>9}{'95 %':>9}{'max':>9}{'count':>9}" * len(topics)]
    for name in UNITS:
        cells = [topic.summary(name) for topic in topics]
        if any(cells):
            lines.append(f"{name:<28}" + "".join(map(_numbers, cells)))
    return "\n".join(lines)


def _numbers(summary: Summary | None) -> str:
    if summary is None:
        return f"{'-':>9}{'-':>9}{'-':>9}{0:>9}"
    return "".join(f"{value:>9.3f}" for value in (summary.median, summary.p95, summary.max)) + f"{summary.count:>9}"


def _frames_line(topic: TopicEvaluation) -> str:
    counts = ", ".join(f"{topic.count(outcome)} {outcome.value.lower().replace('_', ' ')}" for outcome in Outcome
                       if topic.count(outcome))
    jitter_px, drift_px = unrest_px(topic)
    unrest = "" if jitter_px is None or drift_px is None else (
        f"; jitter (above 1 Hz) {jitter_px:.3f} px, drift (below) {drift_px:.3f} px")
    return f"{topic.topic}: {len(topic.rows)} frames: {counts}{unrest}"


def _svf_table(topic: TopicEvaluation) -> Iterator[str]:
    if topic.field is None:
        return
    rows = [f"{one.region:>8}{one.x_px:>9.0f}{one.y_px:>7.0f}{one.u_px:>9.3f}{one.v_px:>9.3f}{one.magnitude_px:>11.3f}"
            f"{one.vectors:>9}" for one in topic.field.regions]
    yield "\n".join([f"  {'region':>6}{'x':>9}{'y':>7}{'u px':>9}{'v px':>9}{'length px':>11}{'vectors':>9}", *rows])


def _points_table(topic: TopicEvaluation) -> Iterator[str]:
    if topic.points:
        head = f"  {'point':<8}{'x':>6}{'y':>6}{'R^2':>8}{'range px':>10}{'displacement px':>17}"
        yield "\n".join([head, *(_point_line(topic, index) for index in range(len(topic.points)))])


def _point_line(topic: TopicEvaluation, index: int) -> str:
    point, displacement = topic.points[index], summarize(topic.point_series("displacement_reference_px", index))
    shown = "-" if displacement is None else f"{displacement.median:.3f}"
    moving = "" if topic.static[index] else "   moves on its own, left out of the means"
    return (f"  {point.name:<8}{point.x_px:>6}{point.y_px:>6}{point.calibration.r2:>8.3f}"
            f"{point.calibration.range_px:>10.1f}{shown:>17}{moving}")


def _finding_lines(topic: TopicEvaluation) -> Iterator[str]:
    found = findings_of(topic)
    if found:
        more = [f"  and {len(found) - _WORST} more"] if len(found) > _WORST else []
        yield "\n".join([*(f"  {one.level.name:<6}{one.text}" for one in found[:_WORST]), *more])


def _short(topic: str) -> str:
    return topic if len(topic) <= 34 else "..." + topic[-31:]
