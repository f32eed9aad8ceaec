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
        shared: (P,) share of the line that both rows show, without its ends.
        overlap: share of one row's pattern that is in the other row, ends and all.
    """

    pairs: IdArray
    weight: float
    shared: FloatArray
    overlap: float


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
    found = np.array([_products(upright, lag).real / lag.overlap for lag in used])  # of as much pattern at each lag
    lasting = _left(turned, time_s, used, np.ones(len(used)))[0]
    expected = (_power(found, lasting, used) * lasting).sum(axis=1)  # of a pattern that lasts
    rho = found.sum(axis=1) / np.maximum(expected, 1e-9)
    left, aslant = _left(turned, time_s, used, np.clip(rho / max(rho[0], 1e-9), 0, 1))
    weight = np.array([lag.weight for lag in used])
    return -float((weight @ aslant) @ (k * _power(found, left, used))) / (len(k) - 1)


def _products(upright: NDArray[np.complex128], lag: Compared) -> NDArray[np.complex128]:
    """(K,) of all pairs of rows."""
    a, b = lag.pairs.T
    return np.asarray((np.conj(upright[a]) * upright[b]).sum(axis=0))


def _left(turned: NDArray[np.complex128], time_s: FloatArray, lags: Sequence[Compared], rho: FloatArray
          ) -> tuple[FloatArray, FloatArray]:
    """Of unit power, by lag and wave number: sums over pairs of the real part of Q, and of time by the imaginary part.

    rho: of the amplitudes, by lag. Pairs of a lag count as equally far apart.
    """
    with_others = np.einsum("tj,jk->tk", _correlation(time_s, lags, rho), np.conj(turned))  # threads of BLAS would wait
    mean_with = turned * with_others / len(time_s)  # r
    mean_power = mean_with.mean(axis=0).real  # g
    left, aslant = np.empty((2, len(lags), turned.shape[1]))
    for i, (lag, alike) in enumerate(zip(lags, rho, strict=True)):
        a, b = lag.pairs.T
        turn, count, dt_s = turned[a[0]] * np.conj(turned[b[0]]), len(a), float((time_s[b] - time_s[a]).mean())
        left[i] = count * alike + (turn * (count * mean_power - mean_with[b].sum(axis=0)
                                           - np.conj(mean_with[a]).sum(axis=0))).real
        seen = (lag.shared[:, None] * (mean_with[b] + np.conj(mean_with[a]))).sum(axis=0)
        aslant[i] = dt_s * (turn * (lag.shared.sum() * mean_power - seen)).imag
    return left, aslant


def _power(found: FloatArray, left: FloatArray, lags: Sequence[Compared]) -> FloatArray:
    """(K,) of the pattern before anything was taken out; 0 where next to nothing is left."""
    weight = np.array([lag.weight for lag in lags])
    least = _LEAST_LEFT * float(weight @ [len(lag.pairs) for lag in lags])
    have = weight @ left
    return np.asarray(np.where(have > least, np.maximum(weight @ found, 0) / np.maximum(have, least), 0.0))


def _correlation(time_s: FloatArray, lags: Sequence[Compared], rho: FloatArray) -> FloatArray:
    """(T, T), 1 at no lag; linear between the lags and constant after the last."""
    at_s = [0.0, *(float(np.median(np.diff(time_s[lag.pairs], axis=1))) for lag in lags)]
    return np.asarray(np.interp(np.abs(time_s[:, None] - time_s), at_s, [1.0, *rho]))
