"""Times several ways of doing the same side by side: each frame by all of them, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter_ns, process_time_ns

from scenes import Scene
from spread import Spread
from tqdm import tqdm

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Frame, Homography

_WARM_UP = 3  # rounds; the first is the reference


@dataclass(frozen=True)
class Runner:
    """run(frame, truth) is what is timed. every: takes part in every n-th round.

    beside: the runner it is compared with. tracks: run gives back a homography, or None where the frame is lost.
    """

    name: str
    run: Callable[[Frame, Homography], Homography | None]
    every: int = 1
    tracks: bool = False
    beside: str = ""


@dataclass(frozen=True)
class Lap:
    """One runner's times: ms on the clock by round, cpu_ms on all cores together. error_px: to the truth."""

    ms: dict[int, float] = field(default_factory=dict)
    cpu_ms: list[float] = field(default_factory=list)
    error_px: list[float] = field(default_factory=list)

    def add(self, number: int, runner: Runner, frame: Frame, truth: Homography) -> None:
        """One round of the runner's."""
        start_ns, cpu_start_ns = perf_counter_ns(), process_time_ns()
        found = runner.run(frame, truth)
        end_ns, cpu_end_ns = perf_counter_ns(), process_time_ns()
        self.ms[number] = (end_ns - start_ns) / 1e6
        self.cpu_ms.append((cpu_end_ns - cpu_start_ns) / 1e6)
        if found is not None:
            self.error_px.append(rms_distance(found, truth, frame.size))

    def times(self) -> Spread:
        return Spread.of(list(self.ms.values()))

    @property
    def lost(self) -> int:
        """Of a tracker's frames."""
        return len(self.ms) - len(self.error_px)

    def ratio(self, other: Lap) -> float:
        """How much longer this one takes than the other: median over the rounds that both ran."""
        return Spread.of([self.ms[k] / other.ms[k] for k in self.ms.keys() & other.ms.keys()]).median


def race(runners: Sequence[Runner], scene: Scene, rounds: int) -> dict[str, Lap]:
    """Results by name. Who begins changes from round to round: the first to read a frame finds it in no cache."""
    laps = {runner.name: Lap() for runner in runners}
    stream = scene.back_and_forth(_WARM_UP + rounds)
    for number, (frame, truth) in enumerate(tqdm(stream, "race", _WARM_UP + rounds, disable=None, leave=False)):
        due = [runner for runner in runners if number < _WARM_UP or number % runner.every == 0]
        first = number % len(due)
        for runner in due[first:] + due[:first]:
            lap = laps[runner.name] if number >= _WARM_UP else Lap()
            lap.add(number, runner, frame, truth)
    return laps
