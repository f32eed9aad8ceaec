"""Velocities of verticals without vectors, from those that have some.

All methods take many sets of depths and velocities at once, so that a Monte Carlo draw costs one row of a matrix
product. Velocities are across the section; negative ones, as in an eddy, are filled like positive ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Protocol

import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.discharge.filling_kriged import by_kriging
from stab_ros.discharge.measured import Measured
from stab_ros.discharge.wetted import DRY, shores_m

_GROUP = 3  # verticals at an edge that tell the velocity beyond
_MARGIN = 1.2  # a polynomial may exceed the largest measured velocity so far
_BEND = 0.5  # how far a line of Froude numbers may leave their mean
_SINGULAR = 1e-9  # share of a determinant that rounding makes
_SPARE = 2  # points that a polynomial needs beyond its coefficients


class Filling(Protocol):
    """A way to fill."""

    def __call__(self, measured: Measured, depth_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
        """Fills the verticals that are not known.

        Args:
            measured: which are.
            depth_m: (D, N), of D draws.
            velocity_m_s: (D, N), surface velocities; what stands at unknown verticals does not count.

        Returns:
            (D, N), with the known ones as they were.
        """


def by_depth(measured: Measured, depth_m: FloatArray, velocity_m_s: FloatArray, power: float) -> FloatArray:
    """The velocity is c h^power, with c from the nearest known verticals.

    Beyond the outermost known verticals, c is that of the three nearest; between known ones it changes linearly.
    With the power 1/2 this is a constant Froude number, v / sqrt(g h) (Le Coz et al. 2008; Fulford and Sauer 1986).
    """
    weights = _weights(measured)
    scale = np.maximum(depth_m, 0.0) ** power
    known = np.where(measured.known, velocity_m_s, 0.0) * scale
    below = (scale**2) @ weights.T
    c = (known @ weights.T) / np.where(below > 0, below, 1.0)
    return np.where(measured.known, velocity_m_s, c * scale)


def _weights(measured: Measured) -> FloatArray:
    """(N, N), how much each known vertical tells of the constant at each unknown one."""
    n = len(measured.chainage_m)
    weights = np.zeros((n, n))
    for i in np.flatnonzero(~measured.known):
        known = measured.neighbours(int(measured.channel[i]))
        left, right = known[known < i][-_GROUP:], known[known > i][:_GROUP]
        for group, share in zip((left, right), _shares(measured.chainage_m, int(i), left, right), strict=True):
            weights[i, group] = share / max(len(group), 1)
    return weights


def _shares(chainage_m: FloatArray, i: int, left: IdArray, right: IdArray) -> tuple[float, float]:
    """How much the known verticals to the left and to the right count at vertical i."""
    if not len(left) or not len(right):
        return float(len(left) > 0), float(len(right) > 0)
    gap_m = chainage_m[right[0]] - chainage_m[left[-1]]
    right_share = float((chainage_m[i] - chainage_m[left[-1]]) / gap_m) if gap_m > 0 else 0.5
    return 1.0 - right_share, right_share


def by_linear_froude(measured: Measured, depth_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """The velocity is c h^(1/2), with c linear over the width (Le Coz et al. 2010), by least squares.

    c stays within half and one and a half times its mean over the known verticals.
    """
    result = np.array(velocity_m_s)
    for channel in np.unique(measured.channel[~measured.known]):
        known, wanted = measured.neighbours(int(channel)), ~measured.known & (measured.channel == channel)
        place = measured.chainage_m - measured.chainage_m[known].mean()
        scale = np.sqrt(np.maximum(depth_m, 0.0))
        line = _line(place[known], scale[:, known], velocity_m_s[:, known])
        mean = _line(place[known], scale[:, known], velocity_m_s[:, known], sloped=False)
        c = line @ np.stack([np.ones(wanted.sum()), place[wanted]])
        low, high = np.sort(np.stack([mean[:, :1] * (1 - _BEND), mean[:, :1] * (1 + _BEND)]), axis=0)
        result[:, wanted] = np.clip(c, low, high) * scale[:, wanted]
    return result


def _line(place_m: FloatArray, scale: FloatArray, velocity_m_s: FloatArray, sloped: bool = True) -> FloatArray:
    """(D, 2), the c and its slope that fit velocities (D, K) = (c + slope place) scale best."""
    sums = [(scale**2 * place_m**power).sum(axis=1) for power in range(3)]
    right = [(scale * velocity_m_s * place_m**power).sum(axis=1) for power in range(2)]
    least = np.where(sums[0] > 0, sums[0], 1.0)
    determinant = sums[0] * sums[2] - sums[1] ** 2
    safe = determinant > _SINGULAR * sums[0] * sums[2]
    slope = np.where(safe & sloped, (sums[0] * right[1] - sums[1] * right[0]) / np.where(safe, determinant, 1.0), 0.0)
    return np.stack([(right[0] - slope * sums[1]) / least, slope], axis=1)


def by_polynomial(measured: Measured, depth_m: FloatArray, velocity_m_s: FloatArray, degree: int) -> FloatArray:
    """A polynomial over the width of each channel, by least squares, with a velocity of 0 at its shores.

    Filled velocities lie between 0 and 1.2 times the largest measured one. A channel with too few points for the
    polynomial is filled by a constant Froude number.
    """
    result = by_depth(measured, depth_m, velocity_m_s, 0.5)
    for channel in np.unique(measured.channel[measured.channel != DRY]):
        inside = measured.channel == channel
        own = np.flatnonzero(inside & measured.known)
        shores = shores_m(measured.chainage_m, measured.depth_m, inside)
        if len(own) + len(shores) < degree + 1 + _SPARE or len(own) <= degree:
            continue
        operator = _operator(measured.chainage_m[own], shores, measured.chainage_m[inside], degree)
        known = velocity_m_s[:, own]
        bound = _MARGIN * known[np.arange(len(known)), np.abs(known).argmax(axis=1)][:, None]
        fitted = np.clip(known @ operator.T, np.minimum(bound, 0.0), np.maximum(bound, 0.0))
        result[:, inside] = np.where(measured.known[inside], result[:, inside], fitted)
    return result


def _operator(known_m: FloatArray, shores_m_: FloatArray, wanted_m: FloatArray, degree: int) -> FloatArray:
    """(wanted, known) matrix from known velocities to those of the fitted polynomial."""
    rows_m = np.concatenate([known_m, shores_m_])
    middle, half = (rows_m.min() + rows_m.max()) / 2, max(float(np.ptp(rows_m)) / 2, 1e-9)
    design, at = (np.vander((places - middle) / half, degree + 1) for places in (rows_m, wanted_m))
    return np.asarray(at @ np.linalg.pinv(design)[:, : len(known_m)])


FILLINGS: Mapping[str, Filling] = MappingProxyType({
    "kriging": by_kriging, "froude": partial(by_depth, power=0.5), "froude_linear": by_linear_froude,
    "klt_iv": partial(by_depth, power=1.0), "quadratic": partial(by_polynomial, degree=2),
    "cubic": partial(by_polynomial, degree=3)})
