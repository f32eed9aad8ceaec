"""The steady motion that fits positions over time best, as that of water is, and what is not steady."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from stab_ros.core.types import FloatArray

Rate: TypeAlias = tuple[float, float]  # (x, y) px/s


def unsteady_px(elapsed_s: FloatArray, away_px: FloatArray) -> float:
    """RMS distance of (n, 2) px after (n,) s from the steady motion that fits them best."""
    unsteady = away_px - elapsed_s[:, None] * np.array(rate_of(elapsed_s, away_px))
    return float(np.sqrt(np.mean(np.sum(unsteady**2, axis=1))))


def rate_of(elapsed_s: FloatArray, away_px: FloatArray) -> Rate:
    """px/s of the line through the origin and (n, 2) px after (n,) s; zero where no time has passed."""
    x, y = elapsed_s @ away_px / max(float(elapsed_s @ elapsed_s), 1e-9)
    return float(x), float(y)
