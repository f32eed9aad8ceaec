"""What the user is told of ambiguous ground and of parallax."""

from __future__ import annotations

import numpy as np

from stab_ros.io.advice import ambiguous_ground, parallax
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.planes import Plane


def test_advice_says_what_was_found_and_what_to_do() -> None:
    plane = Plane(np.ones(4, bool), np.eye(3)[None])
    assert ambiguous_ground(CompetingHypothesis(plane, 0.25, (3.0, 0.0), (0.0, 0.0), (3.0, 4.0), 1.0, 1.0)) == (
        "what is ground is ambiguous: taken is a plane with 75 % of the features, which goes 0.0 px/s towards 0 "
        "degrees; another with 25 %, which goes 5.0 px/s towards 53 degrees, may be it as well; "
        "name the water in exclude or the banks in roi")
    assert parallax(Relief(0.25, 30.0)) == (
        "parallax: parts of the ground are shifted against the rest by 0.25 px towards 30 or 210 degrees, as if they "
        "were no plane; homographies may be off by several times that, name ground at the height of the water in roi")
