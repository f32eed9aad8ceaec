"""What is told of many numbers: median, 5 % and 95 %, largest, and how many there were."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Statistics of `count` numbers; NaN where there are none."""

    p5: float
    median: float
    p95: float
    max: float
    count: int

    @staticmethod
    def of(values: Sequence[float]) -> Spread:
        shown = values or [float("nan")]
        p5, median, p95, largest = (float(value) for value in np.percentile(shown, [5, 50, 95, 100]))
        return Spread(p5, median, p95, largest, len(values))

    def data(self) -> dict[str, float | None]:
        """For JSON, which knows no NaN; six digits."""
        told: dict[str, float | None] = {
            name: None if math.isnan(value) else float(f"{value:.6g}") for name, value in asdict(self).items()
        }
        return told | {"count": self.count}
