"""What the user is told of ambiguous ground, parallax, rows that swing, lost frames and what moves with the camera."""

from __future__ import annotations

import numpy as np
import pytest
from truth import frame, picture

from stab_ros.core.types import LostReason
from stab_ros.io.advice import (
    FixedToCamera,
    ambiguous_ground,
    by_reason,
    copied_by_codec,
    often_lost,
    parallax,
    remarks,
    rolling_shutter,
    simpler_model,
    to_try,
)
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.planes import Plane
from stab_ros.tracking.rolling_shutter import Swing


def test_advice_says_what_was_found_and_what_to_do() -> None:
    plane = Plane(np.ones(4, bool), np.eye(3)[None])
    assert ambiguous_ground(CompetingHypothesis(plane, 0.25, (3.0, 0.0), (0.0, 0.0), (3.0, 4.0), 1.0, 1.0)) == (
        "what is ground is ambiguous: taken is a plane with 75 % of the features, which goes 0.0 px/s towards 0 "
        "degrees; another with 25 %, which goes 5.0 px/s towards 53 degrees, may be it as well; "
        "name the water in exclude or the banks in roi")
    assert parallax(Relief(0.25, 30.0)) == (
        "parallax: parts of the ground are shifted against the rest by 0.25 px towards 30 or 210 degrees, as if they "
        "were no plane; homographies may be off by several times that, name ground at the height of the water in roi")


@pytest.mark.parametrize("reason", LostReason)
def test_there_is_something_to_try_for_each_reason(reason: LostReason) -> None:
    assert f"20 of 100 frames are lost, most often {reason.value} (20): {to_try(reason)}" == often_lost(
        {reason: 20}, frames=100)


def test_the_most_frequent_reason_comes_first() -> None:
    lost = {LostReason.NO_FEATURES: 2, LostReason.UNCERTAIN: 5}
    assert by_reason(lost) == "5 too uncertain, 2 no features found"
    assert often_lost(lost, 40).startswith("7 of 40 frames are lost, most often too uncertain (5): ")


@pytest.mark.parametrize(("lost", "frames"), [(0, 0), (0, 10), (1, 20), (5, 100)])
def test_few_lost_frames_need_no_advice(lost: int, frames: int) -> None:
    assert often_lost({LostReason.UNCERTAIN: lost} if lost else {}, frames) == ""
    assert often_lost({LostReason.UNCERTAIN: lost + 1}, frames) != ""


def test_what_moves_with_the_camera_is_told_once_for_each_reference() -> None:
    first, second, fixed = frame(picture()), frame(picture(), 1), FixedToCamera()
    assert fixed.news(None, 0.3) == ""
    assert fixed.news(first, 0.005) == ""
    assert fixed.news(first, 0.0312) == ("3.1 % of the picture is fixed to the camera (overlay, dirt, hot pixels, "
                                         "borders) and is not used as ground")
    assert fixed.news(first, 0.2) == ""
    assert fixed.news(second, 0.2).startswith("20.0 % of the picture")
    assert rolling_shutter(Swing(71, 1.25)) == (
        "rolling shutter: the rows of 71 frames swing by up to 1.25 px; image_stabilized corrects it, homographies "
        "alone do not, sigma_px includes what they leave")


def test_a_simpler_model_is_told_with_its_frames() -> None:
    assert simpler_model(0) == ""
    assert simpler_model(7).startswith("7 frames show ground on one side only, so a similarity took the place")


def test_each_reason_is_told_once() -> None:
    assert remarks(None, None, None, None) == []
    assert remarks(None, Relief(0.25, 30.0), Swing(3, 0.5), 0.75) == [
        parallax(Relief(0.25, 30.0)), rolling_shutter(Swing(3, 0.5)), copied_by_codec(0.75)]
    assert copied_by_codec(0.75).startswith("low bitrate: the video codec has copied 75 % of what is tracked")
