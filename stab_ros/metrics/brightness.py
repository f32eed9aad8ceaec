"""Brightness of the same windows in two pictures: RMSD takes a change for motion, so it is measured and matched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray


@dataclass(frozen=True)
class Brightness:
    """`b = gain a + offset` for grey levels a and b of two pictures; change: of the mean level, relative to it."""

    gain: float
    offset: float
    change: float

    def matched(self, windows: FloatArray) -> FloatArray:
        """Windows of the second picture as bright as those of the first."""
        return np.asarray((windows - self.offset) / self.gain)


def brightness(a: FloatArray, b: FloatArray) -> Brightness:
    """From the same windows, (P, N, N), of two pictures, P > 0; medians, so that a moving window does not matter.

    The gain is what spread and mean agree on: blur lowers the spread alone, a shadow or haze the mean alone.
    """
    mean_a, mean_b = a.mean(axis=(1, 2)), b.mean(axis=(1, 2))
    change = float(np.median(mean_b / np.maximum(mean_a, 1.0))) - 1
    spread = float(np.median(b.std(axis=(1, 2)) / np.maximum(a.std(axis=(1, 2)), 1e-3)))
    low, high = sorted((1.0, max(1 + change, 0.1)))
    gain = min(max(spread, low), high)
    return Brightness(gain, float(np.median(mean_b - gain * mean_a)), change)
