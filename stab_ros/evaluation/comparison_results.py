"""The result of a comparison: every frame as every method registered it, and what the evaluator measured of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.types import Track
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.metrics.statistics import Summary, summarize


@dataclass(frozen=True, eq=False)
class Passage:
    """One frame as a method saw it. reference: whether it is what others are brought back to.

    error_px: against the truth, None without one, while lost, and for the reference. seconds: tracking and warping.
    """

    number: int
    track: Track
    reference: bool
    error_px: float | None
    seconds: float | None


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What came of one method. passages: one a frame. evaluation: None if no frame became the reference.

    peak_mb: of its process. failure: why there is nothing of all that, in one line; "" if there is.
    """

    name: str
    passages: tuple[Passage, ...] = ()
    evaluation: TopicEvaluation | None = None
    peak_mb: int | None = None
    failure: str = ""

    @property
    def tracked(self) -> int:
        """Frames, the reference among them."""
        return sum(one.track.tracked for one in self.passages)

    @property
    def lost(self) -> int:
        return len(self.passages) - self.tracked

    @property
    def reference(self) -> int | None:
        """The number of the frame that became the (first) reference."""
        return next((one.number for one in self.passages if one.reference), None)

    @property
    def aligned(self) -> list[Passage]:
        """Those that statistics are made of: neither the reference nor what was lost."""
        return [one for one in self.passages if one.track.tracked and not one.reference]

    @property
    def error_px(self) -> Summary | None:
        return summarize([one.error_px for one in self.aligned if one.error_px is not None])

    @property
    def seconds(self) -> list[float]:
        """Of every frame after the reference, lost or not."""
        first = self.reference
        return [] if first is None else [one.seconds for one in self.passages
                                         if one.number > first and one.seconds is not None]


@dataclass(frozen=True, eq=False)
class Comparison:
    """What came of a job. raw: the frames as they are. warnings: one line each, what could not be read or compared."""

    source: Path
    frames: int
    raw: MethodResult
    methods: tuple[MethodResult, ...]
    has_truth: bool
    warnings: tuple[str, ...]
