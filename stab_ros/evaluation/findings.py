"""Problems of a stabilised frame, by the thresholds of the settings."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.settings import EvaluatorConfig


class Level(IntEnum):
    """Level of a diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Finding:
    """A problem of one frame, as a line that names the frame."""

    level: Level
    text: str


def frame_name(metrics: FrameMetrics) -> str:
    """Number and stamp of a frame, as every text shows them."""
    return f"frame {metrics.frame} ({metrics.stamp_ns / 1e9:.3f} s)"


def findings(metrics: FrameMetrics, config: EvaluatorConfig) -> list[Finding]:
    """All problems of this frame, the most severe first."""
    if metrics.outcome is Outcome.LOST:
        return [Finding(Level.ERROR, f"{frame_name(metrics)} is lost")]
    if metrics.outcome is not Outcome.MEASURED:
        return []
    found = [*_points(metrics), *_displacement(metrics, config), *_rmse(metrics, config), *_frozen(metrics, config),
             *_brightness(metrics, config)]
    return sorted(found, key=lambda one: -one.level)


def _points(metrics: FrameMetrics) -> list[Finding]:
    if metrics["points_used"] != 0:
        return []
    return [Finding(Level.WARN, f"{frame_name(metrics)}: no verification point can be seen, so there is no RMSD")]


def _displacement(metrics: FrameMetrics, config: EvaluatorConfig) -> list[Finding]:
    limits = config.displacement_warn_px, config.displacement_error_px
    beyond = " or more" if metrics["points_beyond_range"] else ""
    text = f"displaced by {{}} px{beyond} against the"
    return [*_above(metrics, "displacement_reference_px", f"{text} reference", limits),
            *_above(metrics, "displacement_previous_px", f"{text} frame before", limits)]


def _rmse(metrics: FrameMetrics, config: EvaluatorConfig) -> list[Finding]:
    limits = config.rmse_warn_px, config.rmse_error_px
    return [*_above(metrics, "rmse_reference_px", "RMSE {} px against the reference", limits),
            *_above(metrics, "rmse_previous_px", "RMSE {} px against the frame before", limits)]


def _above(metrics: FrameMetrics, name: str, text: str, limits: tuple[float, float]) -> list[Finding]:
    value, (warn, error) = metrics[name], limits
    if value is None or value < min(warn, error):
        return []
    level = Level.ERROR if value >= error else Level.WARN
    return [Finding(level, f"{frame_name(metrics)}: {text.format(f'{value:.2f}')}")]


def _frozen(metrics: FrameMetrics, config: EvaluatorConfig) -> list[Finding]:
    count = int(metrics["identical_frames"] or 0)
    if count < config.frozen_frames:
        return []
    return [Finding(Level.ERROR, f"{frame_name(metrics)}: the picture is frozen, {count} in a row are identical")]


def _brightness(metrics: FrameMetrics, config: EvaluatorConfig) -> list[Finding]:
    change = metrics["brightness_change"]
    if change is None or abs(change) < config.brightness_warn:
        return []
    return [Finding(Level.WARN, f"{frame_name(metrics)}: brightness changed by {100 * change:+.1f} % against the "
                    "reference, RMSD shows that too and not motion alone")]
