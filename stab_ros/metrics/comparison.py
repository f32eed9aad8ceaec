"""The windows of one picture against the same windows of another: RMSD, and the displacement that it stands for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.metrics.alignment import kept_share
from stab_ros.metrics.brightness import brightness
from stab_ros.metrics.rmsd import rmsd
from stab_ros.metrics.verification import VerificationPoint


@dataclass(frozen=True, eq=False)
class PointComparison:
    """For P points, NaN where a window could not be used. beyond: (P,) bool, past the range of d(RMSD)."""

    rmsd: FloatArray
    displacement_px: FloatArray
    beyond: BoolArray
    brightness_change: float


def compare(points: Sequence[VerificationPoint], before: FloatArray, after: FloatArray, followed: FloatArray,
            moved_px: FloatArray, usable: BoolArray, noise_variance: FloatArray) -> PointComparison:
    """Windows (P, N, N) of two pictures: `before`, `after` in the same place, and `followed`, after the shift (or NaN).

    moved_px: (P, 2) that shift. noise_variance: (P,) of both together, grey levels^2. RMSD is Eq. 2 of Ljubicic et al.
    2021. For the displacement, Eq. 3, the brightness is matched first, and what no displacement explains is taken out
    of RMSD^2.
    """
    count = len(points)
    found = PointComparison(np.full(count, np.nan), np.full(count, np.nan), np.zeros(count, bool), 0.0)
    if not usable.any():
        return found
    light = brightness(before[usable], after[usable])
    unexplained = _unexplained(rmsd(before, light.matched(followed)) ** 2, kept_share(moved_px), noise_variance)
    moved = np.sqrt(np.maximum(rmsd(before, light.matched(after)) ** 2 - unexplained, 0))
    found.rmsd[usable] = rmsd(before, after)[usable]
    for i in np.flatnonzero(usable).tolist():
        calibration = points[i].calibration
        found.displacement_px[i] = calibration.displacement_towards_px(float(moved[i]), moved_px[i])
        found.beyond[i] = bool(calibration.beyond(moved[i]))
    return PointComparison(found.rmsd, found.displacement_px, found.beyond, light.change)


def _unexplained(left: FloatArray, kept: FloatArray, noise_variance: FloatArray) -> FloatArray:
    """(P,) grey levels^2: what differs without any displacement.

    It is what is `left` where the content was followed, and what noise the following has averaged out. The gauge
    takes the finest texture for noise, so there is never more noise than `left` has room for. Where the content
    could not be followed (NaN), the gauge is all there is.
    """
    after = np.minimum(noise_variance / 2, left / (1 + kept))
    return np.asarray(np.where(np.isfinite(left), left + after * (1 - kept), noise_variance))
