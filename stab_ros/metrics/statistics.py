"""Summary statistics of a series of values, including those of a box plot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_WHISKER_IQR = 1.5


@dataclass(frozen=True)
class Summary:
    """Statistics of `count` values, in their unit.

    Attributes:
        q1, median, q3, p95: percentiles, linearly interpolated.
        whisker_low, whisker_high: outermost values within 1.5 interquartile ranges of the quartiles (Tukey's box plot,
            as in Ljubicic et al. 2021, figures 11 to 14).
        outliers: values outside the whiskers, ascending.
    """

    median: float
    p95: float
    max: float
    count: int
    mean: float
    q1: float
    q3: float
    whisker_low: float
    whisker_high: float
    outliers: tuple[float, ...]


def summarize(values: Sequence[float]) -> Summary | None:
    """Statistics of the finite values (NaN: not measured); None without any."""
    known = np.sort(np.asarray(values, np.float64))
    known = known[np.isfinite(known)]
    if not len(known):
        return None
    q1, median, q3, p95 = map(float, np.percentile(known, [25, 50, 75, 95]))
    reach = _WHISKER_IQR * (q3 - q1)
    inside = known[(known >= q1 - reach) & (known <= q3 + reach)]
    beyond = known[(known < q1 - reach) | (known > q3 + reach)]
    return Summary(
        median=median, p95=p95, max=float(known[-1]), count=len(known), mean=float(known.mean()), q1=q1, q3=q3,
        whisker_low=min(float(inside[0]), q1), whisker_high=max(float(inside[-1]), q3), outliers=tuple(beyond.tolist()),
    )
