"""Brightness change between two images: it would count as motion in RMSD, so it is measured and compensated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray


@dataclass(frozen=True)
class Brightness:
    """Brightness change `b = gain * a + offset` between the grey levels a and b of two images.

    Attributes:
        gain: dimensionless.
        offset: grey levels.
        change: relative change of the mean grey level.
    """

    gain: float
    offset: float
    change: float

    def matched(self, windows: FloatArray) -> FloatArray:
        """Windows of the second image with the brightness of the first."""
        return np.asarray((windows - self.offset) / self.gain)


def brightness(a: FloatArray, b: FloatArray) -> Brightness:
    """Brightness change between the same windows (P, N, N), P > 0, of two images; medians over the windows.

    The gain is limited to the range that both contrast and mean support: blur lowers only the contrast, a shadow or
    haze only the mean.
    """
    mean_a, mean_b = a.mean(axis=(1, 2)), b.mean(axis=(1, 2))
    change = float(np.median(mean_b / np.maximum(mean_a, 1.0))) - 1
    spread = float(np.median(b.std(axis=(1, 2)) / np.maximum(a.std(axis=(1, 2)), 1e-3)))
    low, high = sorted((1.0, max(1 + change, 0.1)))
    gain = min(max(spread, low), high)
    return Brightness(gain, float(np.median(mean_b - gain * mean_a)), change)
