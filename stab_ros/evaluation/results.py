"""The result of an evaluation: every frame of every stream of a recording."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stab_ros.core.text import are, counted
from stab_ros.core.types import BoolArray, Frame
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.settings import EvaluatorConfig
from stab_ros.metrics.statistics import Summary, summarize
from stab_ros.metrics.velocity_field import Field, mean_field
from stab_ros.metrics.verification import VerificationPoint

_REMARKS_ON_HOT_PIXELS = ("the camera has hot or dead pixels: they are left out of every picture, and are no points",)
_STABILISED = "image_stabilized"  # as such a topic ends


@dataclass(frozen=True, eq=False)
class TopicEvaluation:
    """The evaluation of one stream. reference: the given one, else its first frame. static: (P,) bool, at the end.

    rows: one for each frame. fps: of the settings, else of the stream. camera_fixed: (P,) bool, points on something
    that moves with the camera. hot_pixels: whether such were left out of all images. named: whether the points are the
    user's.
    """

    topic: str
    reference: Frame
    points: tuple[VerificationPoint, ...]
    static: BoolArray
    rows: tuple[FrameMetrics, ...]
    config: EvaluatorConfig
    fps: float
    camera_fixed: BoolArray = dataclasses.field(default_factory=lambda: np.empty(0, bool))
    hot_pixels: bool = False
    named: bool = False

    @property
    def measured(self) -> tuple[FrameMetrics, ...]:
        """The frames that statistics include: neither the reference nor lost frames."""
        return tuple(row for row in self.rows if row.outcome is Outcome.MEASURED)

    def count(self, outcome: Outcome) -> int:
        return sum(row.outcome is outcome for row in self.rows)

    def series(self, name: str) -> list[float]:
        """The values of a metric, over all measured frames that have it."""
        return [value for row in self.measured if (value := row[name]) is not None]

    def summary(self, name: str) -> Summary | None:
        return summarize(self.series(name))

    def point_series(self, name: str, point: int) -> list[float]:
        """The values of a metric at one verification point, over all measured frames that have it."""
        values = [row.points[name][point] for row in self.measured if name in row.points]
        return [float(value) for value in values if np.isfinite(value)]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the verification points could not see, one line each."""
        return (*self._remarks_on_points(), *_REMARKS_ON_HOT_PIXELS[: self.hot_pixels])

    def _remarks_on_points(self) -> tuple[str, ...]:
        count, of = int(self.camera_fixed.sum()), len(self.points)
        if not count:
            return ()
        points = f"{count} of {counted(of, 'verification point')}"
        left = "counted all the same, as you named them" if self.named else "left out"
        return (f"{points} {are(count)} moving with the camera, as dirt on the lens or an overlay does: {left}",)

    @property
    def field(self) -> Field | None:
        """The residual velocity field, averaged over the frames where it was measured."""
        fields = [row.field for row in self.measured if row.field is not None]
        return mean_field(fields) if fields else None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The evaluation of a recording. frames: of the first stream. warnings: unreadable parts, one line each."""

    source: Path
    frames: int
    topics: tuple[TopicEvaluation, ...]
    warnings: tuple[str, ...]

    @property
    def stabilised_first(self) -> Evaluation:
        """The same, with the stabilised streams before the raw ones, as tables and reports show them."""
        ordered = sorted(self.topics, key=lambda one: not one.topic.endswith(_STABILISED))
        return dataclasses.replace(self, topics=tuple(ordered))
