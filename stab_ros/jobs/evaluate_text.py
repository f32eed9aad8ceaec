"""An evaluation as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from stab_ros.core.text import counted
from stab_ros.evaluation.frame_metrics import COUNTS, TITLES, UNITS, Outcome
from stab_ros.evaluation.results import Evaluation, TopicEvaluation
from stab_ros.evaluation.summary import findings_of, unrest_px
from stab_ros.evaluation.verdict import Answer, Verdict, is_saturated, verdict_of
from stab_ros.metrics.statistics import summarize

_WORST = 5  # findings that are shown
_NAME = 54  # characters
_DISPLACED = "displacement_reference_px"


def as_text(evaluation: Evaluation) -> str:
    """The verdict on each stream, the metrics side by side, then frames, field, points and findings of each."""
    topics = evaluation.stabilised_first.topics
    blocks = ["\n".join(line for topic in topics for line in _verdict_lines(topic)), _metrics_table(topics)]
    for topic in topics:
        blocks += [_frames_line(topic), *_svf_table(topic), *_points_table(topic), *_finding_lines(topic)]
    return "\n\n".join(blocks)


def _verdict_lines(topic: TopicEvaluation) -> Iterator[str]:
    verdict = verdict_of(topic)
    yield f"{topic.topic} {_answer(verdict)}"
    yield from (f"  {line}" for line in topic.remarks)


def _answer(verdict: Verdict) -> str:
    if verdict.answer is Answer.UNKNOWN:
        return f"may stand still or move, that cannot be told: {verdict.reason}"
    more = " or more" if verdict.at_least else ""
    if verdict.answer is Answer.STILL:
        return f"stands still, 95 % of the frames to {verdict.up_to_px:.3f} px"
    return (f"moves by {verdict.moves_px:.3f} px{more} (median; 95 % of the frames by less than "
            f"{verdict.up_to_px:.3f} px{more})")


def _metrics_table(topics: Sequence[TopicEvaluation]) -> str:
    """With the name of each measure in the JSON at the end of its line, for those who look it up there."""
    lines = [f"{'':<{_NAME}}" + "".join(f"{_short(topic.topic):>36}" for topic in topics),
             f"{'':<{_NAME}}" + f"{'median':>9}{'95 %':>9}{'max':>9}{'count':>9}" * len(topics)]
    for name, unit in UNITS.items():
        if any(topic.summary(name) for topic in topics):
            title = TITLES[name] + (f", {unit}" if unit else "")
            lines.append(f"{title:<{_NAME}}" + "".join(_numbers(topic, name) for topic in topics) + f"   {name}")
    return "\n".join(lines)


def _numbers(topic: TopicEvaluation, name: str) -> str:
    summary = topic.summary(name)
    if summary is None:
        return f"{'-':>9}{'-':>9}{'-':>9}{0:>9}"
    return "".join(f"{_value(topic, name, key):>9}" for key in ("median", "p95", "max")) + f"{summary.count:>9}"


def _value(topic: TopicEvaluation, name: str, statistic: str) -> str:
    """A number of a table: counts without decimals, and ">" before one that may be larger."""
    value = getattr(topic.summary(name), statistic)
    if name in COUNTS:
        return f"{value:.0f}"
    return (">" if name == _DISPLACED and is_saturated(topic, statistic) else "") + f"{value:.3f}"


def _frames_line(topic: TopicEvaluation) -> str:
    counts = ", ".join(f"{topic.count(outcome)} {outcome.value.lower().replace('_', ' ')}" for outcome in Outcome
                       if topic.count(outcome))
    jitter_px, drift_px = unrest_px(topic)
    unrest = "" if jitter_px is None or drift_px is None else (
        f"; jitter (above 1 Hz) {jitter_px:.3f} px, drift (below) {drift_px:.3f} px")
    return f"{topic.topic}: {counted(len(topic.rows), 'frame')}: {counts}{unrest}"


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
    why = "moves with the camera" if len(topic.camera_fixed) and topic.camera_fixed[index] else "moves on its own"
    moving = "" if topic.static[index] else f"   {why}, left out of the means"
    return (f"  {point.name:<8}{point.x_px:>6}{point.y_px:>6}{point.calibration.r2:>8.3f}"
            f"{point.calibration.range_px:>10.1f}{shown:>17}{moving}")


def _finding_lines(topic: TopicEvaluation) -> Iterator[str]:
    found = findings_of(topic)
    if found:
        more = [f"  and {len(found) - _WORST} more"] if len(found) > _WORST else []
        yield "\n".join([*(f"  {one.level.name:<6}{one.text}" for one in found[:_WORST]), *more])


def _short(topic: str) -> str:
    return topic if len(topic) <= 34 else "..." + topic[-31:]
