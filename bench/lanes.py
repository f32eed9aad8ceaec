"""Several ways of doing the same, asked frame by frame in turn, so that load hits all alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter_ns

import numpy as np
from scenes import Scene
from spread import Spread
from tables import Table, number
from tqdm import tqdm

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Homography


@dataclass(frozen=True)
class LaneAnswer:
    """What one way said of one frame. errors_px: one for each thing asked, NaN where lost."""

    ms: float
    errors_px: Sequence[float]


@dataclass(frozen=True)
class Lane:
    """One way, and what it said by frame; or why there is none of it."""

    name: str
    ask: Callable[[int], LaneAnswer] | None = None
    absent: str = ""
    answers: dict[int, LaneAnswer] = field(default_factory=dict)

    @property
    def ms(self) -> Spread:
        return Spread.of([answer.ms for answer in self.answers.values()])

    @property
    def errors_px(self) -> list[float]:
        return [error for answer in self.answers.values() for error in answer.errors_px]

    @property
    def error(self) -> Spread:
        return Spread.of([error for error in self.errors_px if np.isfinite(error)])

    def times_as_long(self, other: Lane) -> float:
        """Median over the frames that both saw."""
        both = self.answers.keys() & other.answers.keys()
        return Spread.of([self.answers[k].ms / other.answers[k].ms for k in both]).median


def asked(scene: Scene, ref_H_cur: Callable[[int], Homography | None]) -> Callable[[int], LaneAnswer]:
    """Times it, and compares it with the truth."""

    def ask(index: int) -> LaneAnswer:
        start_ns = perf_counter_ns()
        H = ref_H_cur(index)
        ms = (perf_counter_ns() - start_ns) / 1e6
        return LaneAnswer(ms, [float("nan") if H is None else rms_distance(H, scene.truth[index], scene.size)])

    return ask


def raced(lanes: list[Lane], frames: int) -> list[Lane]:
    """Every frame but the reference through all lanes in turn; the first frame twice, since the first time compiles."""
    present = [lane for lane in lanes if lane.ask is not None]
    for index in tqdm([1, *range(1, frames)], "race", disable=None, leave=False):
        first = index % len(present)
        for lane in present[first:] + present[:first]:
            assert lane.ask is not None
            lane.answers[index] = lane.ask(index)
    return lanes


def lanes_table(title: str, beside: str, lanes: Sequence[Lane], note: str) -> Table:
    """A row for each; times as multiples of those of the lane named `beside`."""
    base = next(lane for lane in lanes if lane.name == beside)
    head = ("", "error median, px", "95 %", "max", "lost", "ms median", "95 %", f"times as long as {beside}", "remark")
    return Table(title, head, [_row(lane, base) for lane in lanes], note)


def _row(lane: Lane, base: Lane) -> tuple[str, ...]:
    if lane.absent:
        return (lane.name, *("" for _ in range(7)), f"not to be had: {lane.absent}")
    lost = len(lane.errors_px) - lane.error.count
    ratio = "" if lane is base else number(lane.times_as_long(base), 2)
    return (lane.name, number(lane.error.median, 4), number(lane.error.p95, 4), number(lane.error.max, 4), str(lost),
            number(lane.ms.median, 2), number(lane.ms.p95, 2), ratio, "")


def lanes_data(lanes: Sequence[Lane], beside: str) -> Mapping[str, object]:
    """The same for JSON."""
    base = next(lane for lane in lanes if lane.name == beside)
    return {lane.name: {"absent": lane.absent} if lane.absent else
            {"error_px": lane.error.data(), "lost": len(lane.errors_px) - lane.error.count, "ms": lane.ms.data(),
             "times_as_long": lane.times_as_long(base)} for lane in lanes}
