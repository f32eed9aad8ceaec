"""How far a plane has drifted in the image, as evidence for ground: a hovering camera moves little."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.geometry import apply, grid
from stab_ros.core.types import Homography

_MOST_BY_DRIFT = 1.0  # log odds after a second; evidence grows with time
_HOVERING = 0.0015  # of the image width: drift of a hovering camera during the start-up


def drift_odds(own_px: float, other_px: float, width_px: int, elapsed_s: float) -> float:
    """Log odds that a plane that moved by `own_px` is the ground, and not one that moved by `other_px`.

    The drift of the camera has a Cauchy distribution: it hovers, but now and then it does not.
    """
    time = math.sqrt(max(elapsed_s, 1.0))
    usual_px, most = _HOVERING * width_px * time, _MOST_BY_DRIFT * time
    odds = math.log((usual_px**2 + other_px**2) / (usual_px**2 + own_px**2))
    return max(-most, min(odds, most))


def drift_px(ref_H_cur: Homography, size: tuple[int, int]) -> float:
    """How far a frame of `size` (width, height) has moved, on average over its grid, px."""
    return math.hypot(*np.mean(apply(ref_H_cur, grid(size)) - grid(size), axis=0))
