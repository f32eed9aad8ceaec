"""What goes of a drifting pattern with the means of the columns of a space-time image, and how it turns the slope.

The mean over time takes out what stands still, but also contains the pattern that drifts, drawn out along its way. For
a pattern of wave number k that drifts by v, with the correlation rho(t - t') of its amplitude, what is left of
`s(t) = exp(-i k v t)` has the covariance of a centred process,

    Q(a, b) = rho(a, b) + (g - r(b) - conj(r(a))) exp(i k v (b - a)),    r(b) = mean over j of E[conj(s(j)) s(b)],

brought upright, with `g` the mean of `r`. Its imaginary part is the slope that an upright image seems to have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.types import FloatArray, IdArray

_LEAST_LEFT = 0.1  # of the power of a wave number, of which something can be told


@dataclass(frozen=True, eq=False)
class Compared:
    """Rows that are compared with those one lag later.

    Attributes:
        pairs: (P, 2) the rows.
        weight: of each in the slope.
        alike: correlation coefficient.
        shared: (P,) share of the line that both rows show.
    """

    pairs: IdArray
    weight: float
    alike: float
    shared: FloatArray


def apparent_slope(upright: NDArray[np.complex128], k: FloatArray, velocity: float, time_s: FloatArray,
                   lags: Sequence[Compared]) -> float:
    """The slope of J that an upright image has by what was taken out of it, as `stiv_slope` sums it.

    Args:
        upright: (T, K) spectra of the rows, brought upright, of an even number of samples 2 (K - 1).
        k: (K,) wave numbers, 1/px.
        velocity: by which they were brought upright, px/s.
        time_s: (T,) of the rows.
        lags: what is compared, by growing lag.
    """
    used = [lag for lag in lags if lag.weight > 0]
    if not used:
        return 0.0
    turned = np.exp(-1j * np.outer(time_s, k) * velocity)
    mean_with = turned * (_correlation(time_s, used) @ np.conj(turned)) / len(time_s)  # r
    mean_power = mean_with.mean(axis=0).real  # g
    found, left, slope = np.zeros(len(k)), np.zeros(len(k)), np.zeros(len(k))
    for lag in used:
        a, b = lag.pairs.T
        dt_s = time_s[b] - time_s[a]
        apart = (mean_power - mean_with[b] - np.conj(mean_with[a])) * turned[a] * np.conj(turned[b])
        found += lag.weight * (np.conj(upright[a]) * upright[b]).real.sum(axis=0)
        left += lag.weight * (lag.alike / used[0].alike + apart.real).sum(axis=0)
        slope -= lag.weight * k * ((lag.shared * dt_s) @ apart.imag)
    count = sum(lag.weight * len(lag.pairs) for lag in used)
    power = np.where(left > _LEAST_LEFT * count, np.maximum(found, 0) / np.maximum(left, _LEAST_LEFT * count), 0.0)
    return float(power @ slope) / (len(k) - 1)


def _correlation(time_s: FloatArray, lags: Sequence[Compared]) -> FloatArray:
    """rho (T, T), 1 at no lag; linear between the lags and constant after the last."""
    at_s = [0.0, *(float(np.median(np.diff(time_s[lag.pairs], axis=1))) for lag in lags)]
    values = [1.0, *(min(lag.alike / lags[0].alike, 1.0) for lag in lags)]
    return np.interp(np.abs(time_s[:, None] - time_s), at_s, values)
