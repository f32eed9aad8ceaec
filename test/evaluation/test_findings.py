"""Thresholds turn measures into findings that name the frame."""

from __future__ import annotations

from typing import Any

import pytest

from stab_ros.core.errors import ConfigError
from stab_ros.evaluation.findings import Level, findings
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.settings import EvaluatorConfig

CONFIG = EvaluatorConfig()


def metrics(outcome: Outcome = Outcome.MEASURED, **values: float) -> FrameMetrics:
    return FrameMetrics(37, 1_480_000_000, outcome, {"points_used": 12.0, **values})


def test_a_good_frame_has_none() -> None:
    good = metrics(displacement_reference_px=0.1, displacement_previous_px=0.1, rmse_reference_px=0.2,
                   brightness_change=0.01, identical_frames=0.0)
    assert findings(good, CONFIG) == []
    assert findings(metrics(Outcome.REFERENCE), CONFIG) == findings(metrics(Outcome.NO_IMAGE), CONFIG) == []


@pytest.mark.parametrize(("values", "level", "said"), [
    ({"displacement_reference_px": 0.5}, Level.WARN, "displaced by 0.50 px against the reference"),
    ({"displacement_previous_px": 3.04}, Level.ERROR, "displaced by 3.04 px against the frame before"),
    ({"displacement_reference_px": 7.0, "points_beyond_range": 3.0}, Level.ERROR, "displaced by 7.00 px or more"),
    ({"rmse_reference_px": 0.7}, Level.WARN, "RMSE 0.70 px against the reference"),
    ({"identical_frames": 3.0}, Level.ERROR, "frozen"),
    ({"brightness_change": -0.05}, Level.WARN, "brightness changed by -5.0 %"),
    ({"points_used": 0.0}, Level.WARN, "no verification point"),
])
def test_what_is_wrong_is_said_with_the_frame(values: dict[str, float], level: Level, said: str) -> None:
    (found,) = findings(metrics(Outcome.MEASURED, **values), CONFIG)
    assert found.level == level
    assert "frame 37 (1.480 s)" in found.text
    assert said in found.text


def test_a_lost_frame_is_an_error() -> None:
    (found,) = findings(metrics(Outcome.LOST), CONFIG)
    assert (found.level, found.text) == (Level.ERROR, "frame 37 (1.480 s) is lost")


def test_the_worst_comes_first() -> None:
    found = findings(metrics(displacement_reference_px=0.6, rmse_reference_px=2.5, brightness_change=0.2), CONFIG)
    assert [one.level for one in found] == [Level.ERROR, Level.WARN, Level.WARN]


def test_thresholds_are_parameters() -> None:
    config = EvaluatorConfig(displacement_warn_px=0.05, displacement_error_px=0.2)
    assert [one.level for one in findings(metrics(displacement_reference_px=0.1), config)] == [Level.WARN]
    assert [one.level for one in findings(metrics(displacement_reference_px=0.2), config)] == [Level.ERROR]


@pytest.mark.parametrize("wrong", [{"window_px": 30}, {"window_px": 3}, {"displacement_warn_px": 3.0},
                                   {"rmse_error_px": 0.1}])
def test_settings_that_contradict_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong)).split("_")[0]):
        EvaluatorConfig(**wrong)
