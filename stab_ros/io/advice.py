"""Sentences for the user about what the tracker has found: what it is, and what to do about it."""

from __future__ import annotations

import math

from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.rolling_shutter import Swing


def remarks(competing: CompetingHypothesis | None, relief: Relief | None, swing: Swing | None) -> list[str]:
    """One sentence for each reason why homographies may be wrong; None: there is no such reason."""
    found = [] if competing is None else [ambiguous_ground(competing)]
    found = found if relief is None else [*found, parallax(relief)]
    return found if swing is None else [*found, rolling_shutter(swing)]


def ambiguous_ground(competing: CompetingHypothesis) -> str:
    """A second plane may be the ground as well as the chosen one."""
    chosen, other = (f"goes {_heading(drift)}" for drift in (competing.ground_drift_px, competing.drift_px))
    return (f"what is ground is ambiguous: taken is a plane with {100 * (1 - competing.share):.0f} % of the features, "
            f"which {chosen}; another with {100 * competing.share:.0f} %, which {other}, may be it as well; "
            "name the water in exclude or the banks in roi")


def parallax(relief: Relief) -> str:
    """The ground is not one plane."""
    return (f"parallax: parts of the ground are shifted against the rest by {relief.px:.2f} px towards "
            f"{relief.deg:.0f} or {relief.deg + 180:.0f} degrees, as if they were no plane; homographies may "
            "be off by several times that, name ground at the height of the water in roi")


def rolling_shutter(swing: Swing) -> str:
    """Rows are shifted against each other."""
    return (f"rolling shutter: the rows of {swing.frames} frames swing by up to {swing.most_px:.2f} px; "
            "image_stabilized corrects it, homographies alone do not, sigma_px includes what they leave")


def _heading(rate_px: tuple[float, float]) -> str:
    """Speed and direction, 0 degrees to the right, 90 down."""
    degrees = round(math.degrees(math.atan2(rate_px[1], rate_px[0]))) % 360
    return f"{math.hypot(*rate_px):.1f} px/s towards {degrees} degrees"
