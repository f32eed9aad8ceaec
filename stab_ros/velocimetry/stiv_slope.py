"""The slope of the pattern in a space-time image: a velocity along its line, with its variance.

What drifts over a line draws slanted stripes into the image of position by time (Fujita, Watanabe and Tsubaki 2007).
Their slope is where the autocorrelation of the image is highest (Fujita et al. 2019), here summed over many time lags:

    J(v) = sum over tau, t of w(tau) integral of s(x, t) s(x + v tau, t + tau) dx.

It is sought with short lags over all slopes; then the image is sheared until the stripes stand upright, and the rest of
the slope follows by Newton's method with lags that grow. Upright, each stripe stays in its column. So columns far
enough apart are independent measurements of the slope, and their scatter gives its variance, also where the pattern
changes with time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.velocimetry.stiv_spectra import Spectra
from stab_ros.velocimetry.stiv_standing import Compared, apparent_slope

_SEARCH_LAGS = (1, 2, 3, 4)  # frames
_SEARCH_STEP_PX = 0.25  # per frame
_COARSE = 4  # steps beyond the range at first
_FARTHER_PX = 64.0  # per frame, in which a pattern must not fit better than in the range
_LEAST_RATIO = 1.1  # of the highest peak of the search to the next
_PEAK_RADIUS = 12  # steps of the search within which no other peak is sought
_STEPS = 2  # of Newton's method for each longest lag
_LAGS = 8  # number of lags, even up to the longest
_STRIPES = 14  # number of columns that is aimed at
_NARROWEST_PX = 12  # of a column; foam and what eddies deform are as wide
_LARGEST_SHARE = 0.9  # of one column in the slope, beyond which its scatter tells nothing
_STANDING = 1.0  # sizes of the pattern on its way, at which the slope is unknown; found on rendered textures
_TWO_SIGMA = 0.97725  # share of a normal distribution below two standard deviations
_LONG_WAY = 50.0  # sizes of the pattern: beyond, what is lost with what stands does not turn the slope
_LEAST_SHARED = 0.4  # of the line: what a lag compares, else few samples are alike by chance
_LEAST_OVERLAP = 0.1  # so that nothing is divided by 0; a lag of less has no weight
_LEAST_WAY = 5.0  # of a pattern, in its sizes: below, too much of it is taken for standing


@dataclass(frozen=True, eq=False)
class Slope:
    """The slope of a space-time image.

    Attributes:
        velocity_px_s: px/s along the line.
        variance_px2_s2: of it.
        correlation: mean correlation coefficient at the lags, weighted as the slope is.
        pairs: (P, 2) the rows that were compared.
        weights: (P,) sum 1.
    """

    velocity_px_s: float
    variance_px2_s2: float
    correlation: float
    pairs: IdArray
    weights: FloatArray


def cleaned(image: FloatArray) -> FloatArray:
    """A space-time image (T, L) without what stands still or flashes everywhere at once.

    The mean of each column is taken out (bed, reflections that stand, vignetting), then that of each row (clouds,
    exposure); then rows are brought to the same contrast. What drifts less than its own size in T is lost with them.
    """
    moving = image - image.mean(axis=0)
    moving = moving - moving.mean(axis=1, keepdims=True)
    contrast = moving.std(axis=1, keepdims=True)
    return np.asarray(moving / np.maximum(contrast, 1e-6))


def farthest_px_s(time_s: FloatArray) -> float:
    """The velocity up to which a slope is sought at least, in a space-time image with rows at times (T,)."""
    return _FARTHER_PX / float(np.median(np.diff(time_s)))


def slope_of(image: FloatArray, time_s: FloatArray, most_px_s: float, widens: bool = False) -> Slope | None:
    """The slope of a cleaned space-time image.

    Args:
        image: (T, L).
        time_s: (T,) of its rows.
        most_px_s: largest velocity.
        widens: whether a larger one, up to `farthest_px_s`, is taken where it fits better; else there is none then, for
            what fits best in the range is so by chance.

    Returns:
        The slope; None: there is no pattern with a clear one.
    """
    spectra = Spectra.of(image, time_s)
    farthest = max(most_px_s, farthest_px_s(time_s))
    velocity = _searched(spectra, most_px_s, farthest)
    if velocity is not None and abs(velocity) > most_px_s:
        velocity, most_px_s = (velocity, farthest) if widens else (None, most_px_s)
    longest = 2
    while velocity is not None and longest < len(image) // 2:
        longest = min(2 * longest, len(image) // 2)
        velocity = _refined(spectra, velocity, longest, most_px_s)
    return None if velocity is None else _measured(spectra, velocity, longest)


def _searched(spectra: Spectra, most_px_s: float, farthest_px_s: float) -> float | None:
    """The velocity, px/s, of the highest J with short lags; None: there is no clear one.

    One beyond the largest velocity, up to the farthest, must fit clearly better; it is sought in larger steps first.
    """
    step = _SEARCH_STEP_PX / float(np.median(np.diff(spectra.time_s)))
    near, far = (int(np.ceil(px_s / step)) for px_s in (most_px_s, farthest_px_s))
    within, out = np.arange(-near, near + 1), np.arange(near + _COARSE, far + 1, _COARSE)
    beyond = np.append(-out, out)
    fits, fits_beyond = _fits(spectra, within * step), _fits(spectra, beyond * step)
    if fits_beyond.max(initial=0.0) <= _LEAST_RATIO * fits.max():
        return _clearest(within * step, fits, step)
    velocity = _clearest(np.append(beyond, within) * step, np.append(fits_beyond, fits), step)
    if velocity is None:
        return None
    around = velocity + np.arange(-_COARSE, _COARSE + 1) * step
    return float(around[_fits(spectra, around).argmax()])


def _fits(spectra: Spectra, velocities: FloatArray) -> FloatArray:
    """(n,) J with short lags, of velocities (n,), px/s."""
    total = np.zeros(len(velocities))
    for lag in _SEARCH_LAGS:
        a, b = spectra.pairs(lag).T
        cross = (np.conj(spectra.rows[a]) * spectra.rows[b]).sum(axis=0)
        dt_s = float((spectra.time_s[b] - spectra.time_s[a]).mean())
        total += (np.exp(1j * np.outer(velocities * dt_s, spectra.k)) @ cross).real
    return total


def _clearest(velocities: FloatArray, total: FloatArray, step: float) -> float | None:
    """That of the highest J, (n,); None: another peak is nearly as high."""
    best = int(np.argmax(total))
    other = np.abs(velocities - velocities[best]) > (_PEAK_RADIUS + 0.5) * step
    next_best = total[other].max(initial=0.0)
    return float(velocities[best]) if total[best] > _LEAST_RATIO * next_best else None


@dataclass(frozen=True, eq=False)
class _Sums:
    """Over columns (C,): slope and curvature of J. Over pairs (P,): shares of it. size_px: of the pattern."""

    slope: FloatArray
    curve: FloatArray
    pairs: IdArray
    weights: FloatArray
    correlation: float
    size_px: float


def _refined(spectra: Spectra, velocity: float, longest: int, most_px_s: float) -> float | None:
    """A step of Newton's method, repeated; None: it leaves the range, or there is no maximum."""
    for _ in range(_STEPS):
        sums = _summed(spectra, velocity, longest)
        if sums is None:
            return None
        velocity += float(sums.slope.sum() / sums.curve.sum())
        if abs(velocity) > most_px_s:
            return None
    return velocity


def _measured(spectra: Spectra, velocity: float, longest: int) -> Slope | None:
    sums = _summed(spectra, velocity, longest)
    if sums is None or abs(velocity) * float(np.ptp(spectra.time_s)) < _LEAST_WAY * sums.size_px:
        return None
    step = float(sums.slope.sum() / sums.curve.sum())
    variance = _scattered(spectra.without_standing(velocity), velocity, longest)
    if not np.isfinite(variance):
        return None
    variance += _lost_with_standing(velocity, sums.size_px, float(np.ptp(spectra.time_s)))
    return Slope(velocity + step, variance, sums.correlation, sums.pairs, sums.weights)


def _scattered(spectra: Spectra, velocity: float, longest: int) -> float:
    """Variance of the slope, px^2/s^2, by the scatter of the columns of the upright image; inf: it has none.

    spectra: with what the mean over time has taken of the pattern given back, which else pulls columns to either side:
    what it adds to one it takes from those that lie as far on as the pattern goes, and the whole does not feel it.

    A column counts by its share of the curvature, as a patch of foam may outweigh all else: HC2 of MacKinnon and White
    (1985), with the degrees of freedom of so many equal columns (Kish 1965).
    """
    sums = _summed(spectra, velocity, longest, centred=False)
    if sums is None:
        return np.inf
    have, total = sums.curve != 0, float(sums.curve.sum())
    pull = (sums.slope - sums.slope.sum() / total * sums.curve)[have]
    share = np.clip(sums.curve[have] / total, 0, _LARGEST_SHARE)
    freedom = max(1 / float((share**2).sum()) - 1, 1.0)
    wider = float(stdtrit(freedom, _TWO_SIGMA) / 2) ** 2  # so that two sigma hold 95 % in spite of few columns
    return wider * float((pull**2 / (1 - share)).sum()) / total**2


def _lost_with_standing(velocity: float, size_px: float, duration_s: float) -> float:
    """Variance, px^2/s^2, by what `cleaned` takes of a pattern that drifts only few of its sizes.

    The mean that is taken out contains the pattern drawn out along its way, which pushes the slope away from upright,
    by 7 % at a way of six sizes. `apparent_slope` takes that back but for less than a tenth of it.
    """
    way_px = abs(velocity) * duration_s
    return float((velocity * (_STANDING * size_px / max(way_px, size_px)) ** 3) ** 2)


def _summed(spectra: Spectra, velocity: float, longest: int, centred: bool = True) -> _Sums | None:
    """Slope and curvature of J at a velocity, by columns of the upright image; None: nothing is alike there.

    centred: whether the mean over time has been taken off the rows, which is then allowed for.
    """
    image, slant, seen = spectra.sheared(velocity)
    image, slant = image * seen, slant * seen
    slope, curve, lags, shares, alike, total = 0.0, 0.0, [], [], 0.0, 0.0
    for lag in np.unique(np.linspace(1, longest, min(_LAGS, longest)).astype(int)):
        two = spectra.pairs(int(lag))
        a, b = two.T
        dt_s = (spectra.time_s[b] - spectra.time_s[a])[:, None]
        power = float((image[a] ** 2 * seen[b]).sum() * (image[b] ** 2 * seen[a]).sum())
        rho = float((image[a] * image[b]).sum()) / np.sqrt(power) if power > 0 else 0.0
        both_seen = (seen[a] * seen[b]).sum(axis=1)
        shared = float(both_seen.sum()) / max(float(seen[a].sum()), 1.0)
        weight = max(rho, 0.0) if shared >= _LEAST_SHARED else 0.0
        bend = weight * dt_s**2 * slant[a] * slant[b]
        both = image[a] * slant[b] * seen[a] - slant[a] * image[b] * seen[b]
        slope = slope + (weight * dt_s * both / 2).sum(axis=0)
        curve = curve + bend.sum(axis=0)
        overlap = max(1 - abs(velocity) * float(dt_s.mean()) / spectra.length_px, _LEAST_OVERLAP)
        lags.append(Compared(two, weight, both_seen / spectra.length_px, overlap))
        shares.append(weight * dt_s[:, 0] ** 2)
        alike, total = alike + weight * rho * len(two), total + weight * len(two)
    weights = np.concatenate(shares)
    if total <= 0 or np.sum(curve) <= 0:
        return None
    size_px = float(np.sqrt((image**2).sum() / (slant**2).sum()))
    if centred and longest >= len(image) // 2 and abs(velocity) * float(np.ptp(spectra.time_s)) < _LONG_WAY * size_px:
        apparent = apparent_slope(spectra.upright(velocity), spectra.k, velocity, spectra.time_s, lags)
        slope = slope - apparent * curve / np.sum(curve)
    return _Sums(_columns(np.asarray(slope), spectra), _columns(np.asarray(curve), spectra),
                 np.concatenate([lag.pairs for lag in lags]), weights / weights.sum(), alike / total, size_px)


def _columns(values: FloatArray, spectra: Spectra) -> FloatArray:
    """Sums (C,) over columns as wide as parts of the line."""
    wide = max(spectra.length_px // _STRIPES, _NARROWEST_PX)
    return np.asarray(np.add.reduceat(values, np.arange(0, len(values), wide)))
