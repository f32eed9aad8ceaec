"""Velocities of verticals without vectors, by how velocity and Froude number change along the section.

At a bank that shelves the velocity falls with the depth, beside an island or a wall it does not, and a surveyed bed
that reaches below dry ground has none. What is measured tells which: v = c h^p with p = 0 (the velocity itself),
1/2 (a Froude number) or 1 (as the released KLT-IV), c by ordinary kriging, weighted by how likely each p makes the
measured velocities (restricted maximum likelihood; Bayesian model averaging, Hoeting et al. 1999).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.discharge.kriging import Kriging
from stab_ros.discharge.measured import Measured
from stab_ros.discharge.wetted import DRY, channel_width_m

_POWERS = (0.0, 0.5, 1.0)
_PRIOR = (0.25, 0.5, 0.25)  # their probabilities before anything is measured
_LENGTH = 0.5  # over which c changes, in widths of the channel
_NOISES = (0.003, 0.03, 0.3)  # variances of c by noise at the mean depth, over that about its mean; equally probable
_MARGIN = 1.2  # a velocity may exceed the largest measured one so far


@dataclass(frozen=True, eq=False)
class _Profile:
    """v = c h^p in one channel.

    Attributes:
        known: (K,), the verticals that tell it.
        wanted: (M,), those to fill.
        depth: (N,), over the mean of the known ones, at least 0.
        power: p.
        kriging: of c.
    """

    known: IdArray
    wanted: IdArray
    depth: FloatArray
    power: float
    kriging: Kriging

    def coefficients(self, depth: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
        """Of D draws of depths and velocities (D, N): (D, K). Drawn depths count as half the nominal ones at least."""
        least = self.depth[self.known] / 2
        return np.asarray(velocity_m_s[:, self.known] / np.maximum(depth[:, self.known], least) ** self.power)

    def filled(self, depth: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
        """Velocities (D, M), between 0 and 1.2 times the largest measured one."""
        c = self.coefficients(depth, velocity_m_s) @ self.kriging.weights
        measured = velocity_m_s[:, self.known]
        bound = _MARGIN * measured[np.arange(len(c)), np.abs(measured).argmax(axis=1)][:, None]
        filled = c * np.maximum(depth[:, self.wanted], 0.0) ** self.power
        return np.asarray(np.clip(filled, np.minimum(bound, 0.0), np.maximum(bound, 0.0)))

    def sigma_m_s(self, velocity_m_s: FloatArray) -> FloatArray:
        """(M,), standard deviation of filled velocities, from nominal ones (N,)."""
        c = self.coefficients(self.depth[None], velocity_m_s[None])[0]
        return np.asarray(self.kriging.sigma(c) * self.depth[self.wanted] ** self.power)

    def log_likelihood(self, velocity_m_s: FloatArray) -> float:
        """Of nominal velocities (N,) at the known verticals."""
        c = self.coefficients(self.depth[None], velocity_m_s[None])[0]
        return self.kriging.log_likelihood(c) - self.power * float(np.log(self.depth[self.known]).sum())


def by_kriging(measured: Measured, depth_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """The mean of the profiles, each weighted by its probability; see `filling.Filling`."""
    result = np.array(velocity_m_s)
    for profiles in _profiles(measured):
        known = profiles[0].known
        depth, weights = depth_m / measured.depth_m[known].mean(), _weights(profiles, velocity_m_s.mean(axis=0))
        result[:, profiles[0].wanted] = sum(weight * one.filled(depth, velocity_m_s)
                                            for weight, one in zip(weights, profiles, strict=True))
    return result


def kriging_sigma_m_s(measured: Measured, velocity_m_s: FloatArray) -> FloatArray:
    """(N,), standard deviation of filled velocities, by each profile and by their difference; 0 at known ones.

    velocity_m_s: (N,); what stands at unknown verticals does not count.
    """
    sigma = np.zeros(len(velocity_m_s))
    for profiles in _profiles(measured):
        depth, weights = profiles[0].depth[None], _weights(profiles, velocity_m_s)
        values = np.stack([one.filled(depth, velocity_m_s[None])[0] for one in profiles])
        square = np.stack([one.sigma_m_s(velocity_m_s) for one in profiles]) ** 2
        sigma[profiles[0].wanted] = np.sqrt(weights @ (square + (values - weights @ values) ** 2))
    return sigma


@functools.lru_cache(maxsize=1)  # a discharge and its draws ask ten times for the same
def _profiles(measured: Measured) -> tuple[list[_Profile], ...]:
    """Of each channel that is not wholly known, one for each power and noise."""
    unknown = measured.channel[~measured.known & (measured.channel != DRY)]
    return tuple(_of_channel(measured, int(channel)) for channel in np.unique(unknown))


def _of_channel(measured: Measured, channel: int) -> list[_Profile]:
    chainage, inside = measured.chainage_m, measured.channel == channel
    known, wanted = measured.neighbours(channel), np.flatnonzero(inside & ~measured.known).astype(np.int64)
    length_m = _LENGTH * channel_width_m(chainage, inside)
    depth = np.maximum(measured.depth_m, 0.0) / measured.depth_m[known].mean()
    return [_Profile(known, wanted, depth, power, Kriging.of(chainage[known], chainage[wanted], length_m,
                                                             noise / depth[known] ** (2 * power)))
            for power in _POWERS for noise in _NOISES]


def _weights(profiles: list[_Profile], velocity_m_s: FloatArray) -> FloatArray:
    """The probability of each, from nominal velocities (N,)."""
    log = np.log(np.repeat(_PRIOR, len(_NOISES))) + np.array([one.log_likelihood(velocity_m_s) for one in profiles])
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())
