"""Positions and attitudes between the samples of a sensor, with their covariance.

Positions lie on a line between two samples, or on a cubic through four (Catmull and Rom 1974, for any spacing);
attitudes turn evenly about one axis (SLERP: Shoemake 1985). Both are local: a frame's answer depends on the samples
next to it alone, so it is the same live and from a recording.
"""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample

Sample = TypeVar("Sample", PositionSample, AttitudeSample)


@dataclass(frozen=True)
class Limits:
    """How far from a sample a sensor is believed.

    Attributes:
        gap_s: from a stamp to the nearest sample.
        extrapolation_s: beyond the first and the last sample.
    """

    gap_s: float = 1.0
    extrapolation_s: float = 0.1


@dataclass(frozen=True, eq=False)
class Interpolated:
    """What a sensor tells of one moment.

    Attributes:
        values: (3,) position, m, or (4,) quaternion x, y, z, w.
        covariance: (3, 3), as of the samples; None: they do not tell.
        interval_s: between the two samples beside it.
        weights: of the samples that count, by their stamps, ns.
    """

    values: FloatArray
    covariance: FloatArray | None
    interval_s: float
    weights: Mapping[int, float]


@dataclass(frozen=True)
class _Bracket:
    """Two samples and a place between them. share: 0 at the first, 1 at the second, beyond where extrapolated."""

    index: int
    share: float
    interval_s: float


def position_at(samples: Sequence[PositionSample], stamp_ns: int, limits: Limits,
                spline: bool = False) -> Interpolated | Unplaced:
    """The position at a moment.

    Args:
        samples: in the order of their stamps.
        stamp_ns: the moment, on their clock.
        limits: how far from a sample it may be.
        spline: on a cubic through two samples before and two after, where there are such; else on a line.

    Returns:
        The position, or why it is not known.
    """
    found = _bracket(samples, stamp_ns, limits, "position")
    if isinstance(found, Unplaced):
        return found
    near, weights = _weights(samples, found, spline)
    position = np.einsum("i,ij->j", weights, np.stack([sample.position_m for sample in near]))
    return Interpolated(position, _combined([s.covariance_m2 for s in near], weights), found.interval_s,
                        _by_stamp(near, weights))


def attitude_at(samples: Sequence[AttitudeSample], stamp_ns: int, limits: Limits) -> Interpolated | Unplaced:
    """The attitude at a moment, as `position_at`; it turns evenly from one sample to the next."""
    found = _bracket(samples, stamp_ns, limits, "attitude")
    if isinstance(found, Unplaced):
        return found
    near = samples[found.index:found.index + 2]
    before, after = (Rotation.from_quat(sample.map_q_body) for sample in near)
    turned = before * Rotation.from_rotvec(found.share * (before.inv() * after).as_rotvec())
    weights = np.array([1 - found.share, found.share])
    covariance = _combined([s.covariance_rad2 for s in near], weights)
    return Interpolated(np.asarray(turned.as_quat()), covariance, found.interval_s, _by_stamp(near, weights))


def _bracket(samples: Sequence[Sample], stamp_ns: int, limits: Limits, what: str) -> _Bracket | Unplaced:
    if len(samples) < 2:
        return Unplaced(f"no {what} came yet" if not samples else f"only one {what} came yet")
    after = bisect.bisect_left(samples, stamp_ns, key=_stamp_ns)
    nearest_ns = min(abs(sample.stamp_ns - stamp_ns) for sample in samples[max(after - 1, 0):after + 1])
    if nearest_ns > limits.gap_s * 1e9:
        return Unplaced(f"the nearest {what} is {nearest_ns / 1e9:.3g} s away, at most {limits.gap_s:g} s are bridged")
    beyond = after == len(samples) or (after == 0 and samples[0].stamp_ns != stamp_ns)
    if beyond and nearest_ns > limits.extrapolation_s * 1e9:
        where = "after the last" if after else "before the first"
        return Unplaced(f"the frame is {nearest_ns / 1e9:.3g} s {where} {what}, at most {limits.extrapolation_s:g} s "
                        "are extrapolated")
    index = min(max(after - 1, 0), len(samples) - 2)
    start_ns, end_ns = samples[index].stamp_ns, samples[index + 1].stamp_ns
    return _Bracket(index, (stamp_ns - start_ns) / (end_ns - start_ns), (end_ns - start_ns) / 1e9)


def _weights(samples: Sequence[PositionSample], at: _Bracket,
             spline: bool) -> tuple[Sequence[PositionSample], FloatArray]:
    """The samples that count, and their weights."""
    i, a = at.index, at.share
    if not spline or i < 1 or i + 2 >= len(samples) or not 0 <= a <= 1:
        return samples[i:i + 2], np.array([1 - a, a])
    near = samples[i - 1:i + 3]
    t = np.array([(sample.stamp_ns - near[1].stamp_ns) / 1e9 for sample in near]) / at.interval_s
    slopes = np.zeros((2, 4))  # of both inner samples, as weights: those of the parabola through three neighbours
    for row, k in enumerate((1, 2)):
        before, after = t[k] - t[k - 1], t[k + 1] - t[k]
        slopes[row, k - 1:k + 2] = [-after / before, after / before - before / after, before / after]
        slopes[row] /= before + after
    ends = np.eye(4)[1:3]
    return near, (ends[0] * (2 * a**3 - 3 * a**2 + 1) + slopes[0] * (a**3 - 2 * a**2 + a)
                  + ends[1] * (3 * a**2 - 2 * a**3) + slopes[1] * (a**3 - a**2))


def _by_stamp(samples: Sequence[Sample], weights: FloatArray) -> dict[int, float]:
    return {sample.stamp_ns: float(weight) for sample, weight in zip(samples, weights, strict=True)}


def _combined(covariances: Sequence[FloatArray | None], weights: FloatArray) -> FloatArray | None:
    """Covariance of a weighted sum of independent samples."""
    known = [covariance for covariance in covariances if covariance is not None]
    if len(known) < len(covariances):
        return None
    return np.asarray(np.einsum("i,ijk->jk", weights**2, np.stack(known)))


def _stamp_ns(sample: PositionSample | AttitudeSample) -> int:
    return sample.stamp_ns
