"""The evaluator whose regions change between two frames, against one that has had them from the start."""

from __future__ import annotations

import numpy as np
import pytest
from truth import IDENTITY, frame, picture, translation

from stab_ros.core.errors import InputError
from stab_ros.core.region import Area, Region
from stab_ros.core.types import Gray
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.settings import EvaluatorConfig

SIZE = (640, 480)
LEFT = Area(roi=Region("roi", (np.array([[0.0, 0], [320, 0], [320, 480], [0, 480]]),)))
BEYOND = Area(roi=Region("roi", (np.array([[9000.0, 0], [9100, 0], [9100, 480]]),)))


def step(evaluator: Evaluator, index: int, image: Gray) -> FrameMetrics:
    shown = frame(image, index)
    return evaluator.step(Arrival(index, shown.stamp_ns, None, False, shown))


def test_after_a_change_the_points_and_their_measures_are_those_of_the_new_regions() -> None:
    images = [picture(IDENTITY, SIZE), *(picture(translation(-0.3 * k, 0.1 * k), SIZE, noise=1.0) for k in range(1, 6))]
    config = EvaluatorConfig(rmse_every=1)
    changed, same = Evaluator(config), Evaluator(config, area=LEFT)
    for index in range(3):
        step(changed, index, images[index])
    changed.change_area(LEFT)
    assert step(same, 0, images[0]).outcome is Outcome.REFERENCE
    assert changed.reference is not None
    assert np.array_equal(changed.reference.image, images[0])
    for index in range(3, 6):
        found, expected = step(changed, index, images[index]), step(same, index, images[index])
        assert [point.name for point in changed.points] == [point.name for point in same.points]
        assert all(point.x_px < 320 for point in changed.points)
        assert found.outcome is Outcome.MEASURED
        assert found.values == pytest.approx(expected.values)


def test_regions_that_do_not_fit_the_reference_change_nothing() -> None:
    images = [picture(IDENTITY, SIZE), *(picture(translation(-0.3 * k, 0.0), SIZE) for k in range(1, 3))]
    refused, untouched = Evaluator(EvaluatorConfig()), Evaluator(EvaluatorConfig())
    for index in range(2):
        step(refused, index, images[index])
        step(untouched, index, images[index])
    with pytest.raises(InputError, match="roi"):
        refused.change_area(BEYOND)
    assert step(refused, 2, images[2]).values == step(untouched, 2, images[2]).values


def test_regions_may_change_before_there_is_a_reference() -> None:
    evaluator = Evaluator(EvaluatorConfig())
    evaluator.change_area(LEFT)
    step(evaluator, 0, picture(IDENTITY, SIZE))
    assert all(point.x_px < 320 for point in evaluator.points)
