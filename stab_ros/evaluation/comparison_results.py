"""The result of a comparison: every frame as every method registered it, and what the evaluator measured of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.types import Track
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.metrics.statistics import Summary, summarize


@dataclass(frozen=True, eq=False)
class Passage:
    """One frame as registered by one method. reference: whether it became the reference.

    error_px: against the truth; None without truth, while lost, and for the reference. seconds: tracking and warping.
    """

    number: int
    track: Track
    reference: bool
    error_px: float | None
    seconds: float | None


@dataclass(frozen=True, eq=False)
class MethodResult:
    """The result of one method. passages: one for each frame. evaluation: None if no frame became the reference.

    peak_mb: peak memory of its process. failure: why the method has no result, in one line; else "".
    """

    name: str
    passages: tuple[Passage, ...] = ()
    evaluation: TopicEvaluation | None = None
    peak_mb: int | None = None
    failure: str = ""

    @property
    def tracked(self) -> int:
        """Number of tracked frames, including the reference."""
        return sum(one.track.tracked for one in self.passages)

    @property
    def lost(self) -> int:
        return len(self.passages) - self.tracked

    @property
    def reference(self) -> int | None:
        """Number of the frame that became the first reference."""
        return next((one.number for one in self.passages if one.reference), None)

    @property
    def aligned(self) -> list[Passage]:
        """The frames that statistics include: neither the reference nor lost frames."""
        return [one for one in self.passages if one.track.tracked and not one.reference]

    @property
    def error_px(self) -> Summary | None:
        return summarize([one.error_px for one in self.aligned if one.error_px is not None])

    @property
    def seconds(self) -> list[float]:
        """Time of every frame after the reference, lost or not."""
        first = self.reference
        return [] if first is None else [one.seconds for one in self.passages
                                         if one.number > first and one.seconds is not None]


@dataclass(frozen=True, eq=False)
class Comparison:
    """The result of a comparison. raw: the frames without stabilisation. warnings: problems, one line each."""

    source: Path
    frames: int
    raw: MethodResult
    methods: tuple[MethodResult, ...]
    has_truth: bool
    warnings: tuple[str, ...]
