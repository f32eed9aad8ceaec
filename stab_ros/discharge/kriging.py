"""Ordinary kriging of a quantity along a section (Matheron 1963; Rasmussen and Williams 2006, sections 2.7 and 4.2.1).

Near what is known the trend there goes on; far from it the value returns to the mean. The correlation is Matern's of
smoothness 5/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray

_SQUARE = 1e-12  # least variance about the mean, over the square of the mean: rounding


@dataclass(frozen=True, eq=False)
class Kriging:
    """How K known values tell M others.

    Attributes:
        weights: (K, M), by which known values add up; those of each wanted one sum to 1.
        variance: (M,), of the error at each wanted one, in variances of the quantity about its mean.
        precision: (K, K), of the known values, in the same, their unknown mean projected out.
        log_volume: logarithm of the determinant of their covariance, and of the precision of that mean.
    """

    weights: FloatArray
    variance: FloatArray
    precision: FloatArray
    log_volume: float

    @staticmethod
    def of(known_m: FloatArray, wanted_m: FloatArray, length_m: float, nugget: FloatArray) -> Kriging:
        """Kriging between places.

        Args:
            known_m: (K,), places along the section.
            wanted_m: (M,).
            length_m: over which the quantity changes.
            nugget: (K,), noise of each known value, in variances of the quantity about its mean; above 0.
        """
        n = len(known_m)
        system = np.ones((n + 1, n + 1))
        system[:n, :n] = _correlation(known_m, known_m, length_m) + np.diag(nugget)
        system[n, n] = 0.0
        right = np.vstack([_correlation(known_m, wanted_m, length_m), np.ones((1, len(wanted_m)))])
        inverse = np.linalg.inv(system)
        solution = inverse @ right
        variance = np.maximum(1 - np.einsum("km,km->m", solution, right), 0)
        return Kriging(solution[:n], variance, inverse[:n, :n], float(np.linalg.slogdet(system)[1]))

    def sigma(self, known: FloatArray) -> FloatArray:
        """Standard deviations (M,) of the errors, where known values (K,) tell how far the quantity lies off its mean.

        The variance that few values tell is uncertain itself, which widens the distribution to that of Student. One
        value tells none.
        """
        return np.asarray(np.sqrt(self._square(known) / max(len(known) - 3, 1) * self.variance))

    def log_likelihood(self, known: FloatArray) -> float:
        """Restricted log-likelihood of known values (K,), at the variance about their mean that is most likely."""
        degrees = len(known) - 1
        least = _SQUARE * float(np.mean(known)) ** 2 + np.finfo(float).tiny
        return -self.log_volume / 2 - degrees / 2 * float(np.log(max(self._square(known), least)))

    def _square(self, known: FloatArray) -> float:
        return max(float(known @ self.precision @ known), 0.0)


def _correlation(from_m: FloatArray, to_m: FloatArray, length_m: float) -> FloatArray:
    """(from, to) of Matern's family with smoothness 5/2."""
    away = np.abs(from_m[:, None] - to_m) / length_m
    return np.asarray((1 + away + away**2 / 3) * np.exp(-away))
