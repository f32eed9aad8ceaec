"""What the user is told of ambiguous ground, of parallax and of a rolling shutter."""

from __future__ import annotations

import numpy as np

from stab_ros.io.advice import ambiguous_ground, parallax, remarks, rolling_shutter
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
    assert rolling_shutter(Swing(71, 1.25)) == (
        "rolling shutter: the rows of 71 frames swing by up to 1.25 px; image_stabilized corrects it, homographies "
        "alone do not, sigma_px includes what they leave")


def test_each_reason_is_told_once() -> None:
    assert remarks(None, None, None) == []
    assert remarks(None, Relief(0.25, 30.0), Swing(3, 0.5)) == [parallax(Relief(0.25, 30.0)),
                                                                rolling_shutter(Swing(3, 0.5))]
