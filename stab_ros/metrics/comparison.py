"""The windows of one picture against the same windows of another: RMSD, and the displacement that it stands for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.metrics.brightness import brightness
from stab_ros.metrics.rmsd import rmsd
from stab_ros.metrics.verification import VerificationPoint


@dataclass(frozen=True, eq=False)
class Comparison:
    """For P points, NaN where a window could not be used. beyond: (P,) bool, past the range of d(RMSD)."""

    rmsd: FloatArray
    displacement_px: FloatArray
    beyond: BoolArray
    brightness_change: float


def compare(points: Sequence[VerificationPoint], before: FloatArray, after: FloatArray, followed: FloatArray,
            usable: BoolArray, noise_variance: FloatArray) -> Comparison:
    """Windows (P, N, N) of two pictures: `before`, `after` in the same place, and `followed`, after the shift (or NaN).

    noise_variance: (P,) of both together, grey levels^2. RMSD is Eq. 2 of Ljubicic et al. 2021. For the displacement,
    Eq. 3, the brightness is matched first, and what no displacement explains is taken out of RMSD^2: the noise's share,
    or what is left where the content was followed, as compression and interpolation leave more than white noise.
    """
    count = len(points)
    found = Comparison(np.full(count, np.nan), np.full(count, np.nan), np.zeros(count, bool), 0.0)
    if not usable.any():
        return found
    light = brightness(before[usable], after[usable])
    unexplained = np.fmax(noise_variance, rmsd(before, light.matched(followed)) ** 2)
    moved = np.sqrt(np.maximum(rmsd(before, light.matched(after)) ** 2 - unexplained, 0))
    found.rmsd[usable] = rmsd(before, after)[usable]
    for i in np.flatnonzero(usable).tolist():
        calibration = points[i].calibration
        found.displacement_px[i] = float(calibration.displacement_px(moved[i]))
        found.beyond[i] = bool(calibration.beyond(moved[i]))
    return Comparison(found.rmsd, found.displacement_px, found.beyond, light.change)
