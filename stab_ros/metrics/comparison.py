"""Windows of one image against the same windows of another one: RMSD and the displacement that explains it."""

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
    """Comparison at P points.

    Attributes:
        rmsd: (P,) grey levels; NaN where a window is not usable.
        displacement_px: (P,); NaN where a window is not usable.
        beyond: (P,) bool, whether the displacement exceeds the range of d(RMSD).
        brightness_change: relative change of the mean grey level.
    """

    rmsd: FloatArray
    displacement_px: FloatArray
    beyond: BoolArray
    brightness_change: float


def compare(points: Sequence[VerificationPoint], before: FloatArray, after: FloatArray, followed: FloatArray,
            moved_px: FloatArray, usable: BoolArray, noise_variance: FloatArray) -> PointComparison:
    """RMSD (Ljubicic et al. 2021, Eq. 2) and displacement (Eq. 3) of the windows of two images.

    For the displacement, the brightness is matched first, and the part of RMSD^2 that no displacement explains is
    subtracted.

    Args:
        points: P verification points.
        before: (P, N, N) windows of the first image.
        after: (P, N, N) windows of the second image at the same positions.
        followed: (P, N, N) windows of the second image moved by `moved_px`; NaN where that is not known.
        moved_px: (P, 2) displacement, x and y.
        usable: (P,) bool.
        noise_variance: (P,) noise variance of the difference of both images, grey levels^2.
    """
    count = len(points)
    found = PointComparison(np.full(count, np.nan), np.full(count, np.nan), np.zeros(count, bool), 0.0)
    if not usable.any():
        return found
    light = brightness(before[usable], after[usable])
    left = rmsd(before, light.matched(followed)) ** 2
    residual_variance = _residual_variance(left, kept_share(moved_px), noise_variance)
    moved = np.sqrt(np.maximum(rmsd(before, light.matched(after)) ** 2 - residual_variance, 0))
    found.rmsd[usable] = rmsd(before, after)[usable]
    for i in np.flatnonzero(usable).tolist():
        calibration = points[i].calibration
        found.displacement_px[i] = calibration.displacement_towards_px(float(moved[i]), moved_px[i])
        found.beyond[i] = bool(calibration.beyond(moved[i]))
    return PointComparison(found.rmsd, found.displacement_px, found.beyond, light.change)


def _residual_variance(left: FloatArray, kept: FloatArray, noise_variance: FloatArray) -> FloatArray:
    """Mean square difference (P,), grey levels^2, that is not due to displacement.

    It is the difference `left` after the displacement is compensated, plus the noise that the interpolation has
    averaged out. The noise measurement includes the finest texture, so the noise is limited to what `left` allows.
    Without a known displacement (NaN), it is the measured noise.
    """
    after = np.minimum(noise_variance / 2, left / (1 + kept))
    return np.asarray(np.where(np.isfinite(left), left + after * (1 - kept), noise_variance))
