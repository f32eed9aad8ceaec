"""Least squares over control points: the solution, its covariance, and what is left when a point is left out.

Terms are those of geodesy: an adjustment, its redundancy, the a posteriori variance factor (Foerstner and Wrobel 2016,
chapter 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm
from scipy.stats import t as student

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.georeferencing.point_noise import PointNoise

_LEAST_REDUNDANCY = 3  # from which on residuals tell the noise: below it sigmas would grow more than sixfold
_WITHIN_3_SIGMA = float(norm.cdf(3))
_EVALUATIONS = 30
_HUGE_PX = 1e7  # in place of residuals that overflow


class Problem(Protocol):
    """What is fitted: pixels as a function of n parameters x, which are 0 at the present state."""

    @property
    def observed_px(self) -> FloatArray:
        """(N, 2), where the points are seen."""

    @property
    def parameters(self) -> int:
        """n, the number of free parameters."""

    def predicted_px(self, x: FloatArray) -> FloatArray:
        """(N, 2), where the points should be seen."""

    def jacobian(self, x: FloatArray) -> FloatArray:
        """(N, 2, n), of `predicted_px`."""

    def ground_jacobian(self) -> FloatArray:
        """(N, 2, 3), of the pixels at x = 0 by the places on the ground, px per m."""

    def prior(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened residuals (m,) of what is known beforehand, and their derivative (m, n)."""


P = TypeVar("P", bound="Problem")
Movable = TypeVar("Movable", bound="MovableProblem")


class MovableProblem(Problem, Protocol):
    """A problem that can be put to another state."""

    def moved(self: Movable, x: FloatArray) -> Movable:
        """The problem at the state x, where x is 0 again."""


@dataclass(frozen=True, eq=False)
class Solution(Generic[P]):
    """An adjusted problem.

    Attributes:
        problem: at its solution.
        used: (N,) bool, the points that were used.
        noise: of the points.
    """

    problem: P
    used: BoolArray
    noise: PointNoise

    @cached_property
    def residuals_px(self) -> FloatArray:
        """(N, 2), observed minus predicted, of all points."""
        return np.asarray(self.problem.observed_px - self.problem.predicted_px(self._zero))

    @cached_property
    def whitening(self) -> FloatArray:
        """W (N, 2, 2), see `PointNoise.whitening`."""
        return self.noise.whitening(self.problem.ground_jacobian())

    @cached_property
    def jacobian(self) -> FloatArray:
        """(N, 2, n), whitened, of all points."""
        return np.asarray(self.whitening @ self.problem.jacobian(self._zero))

    @cached_property
    def whitened(self) -> FloatArray:
        """(N, 2), residuals of all points in their standard deviations."""
        return np.asarray(np.einsum("nij,nj->ni", self.whitening, self.residuals_px))

    @cached_property
    def design(self) -> FloatArray:
        """(2 N' + m, n), whitened derivative of what was used, prior last."""
        rows = self.jacobian[self.used].reshape(-1, self.problem.parameters)
        return np.concatenate([rows, self.problem.prior(self._zero)[1]])

    @cached_property
    def rss(self) -> float:
        """Sum of squares of the whitened residuals that were used."""
        return float(np.sum(self.whitened[self.used] ** 2) + np.sum(self.problem.prior(self._zero)[0] ** 2))

    @property
    def redundancy(self) -> int:
        """Observations less parameters."""
        return len(self.design) - self.problem.parameters

    @property
    def noise_is_measured(self) -> bool:
        """Whether the residuals tell the noise."""
        return self.noise.image_px is None and self.redundancy >= _LEAST_REDUNDANCY

    @cached_property
    def variance_factor(self) -> float:
        """A posteriori variance of whitened residuals; 1 where the noise is known, or the residuals do not tell it."""
        return self.rss / self.redundancy if self.noise_is_measured else 1.0

    @cached_property
    def coverage_factor(self) -> float:
        """By which sigmas grow so that 3 of them hold 99.73 %, as of a normal distribution, 1 where noise is known.

        An error over a sigma that the residuals tell has Student's distribution. Its quantile is larger: 4.09 for 9
        redundant observations.
        """
        return float(student.ppf(_WITHIN_3_SIGMA, self.redundancy)) / 3 if self.noise_is_measured else 1.0

    @property
    def covering_variance(self) -> float:
        """Variance factor whose sigmas cover errors as `coverage_factor` says."""
        return self.variance_factor * self.coverage_factor**2

    @cached_property
    def cofactors(self) -> FloatArray:
        """(n, n), covariance of the parameters for a variance factor of 1; infinite where one cannot be told."""
        scale = np.linalg.norm(self.design, axis=0)
        if not (scale > 0).all():
            return np.full((len(scale), len(scale)), np.inf)
        _, singular, basis = np.linalg.svd(self.design / scale, full_matrices=False)
        if len(singular) < len(scale) or singular[-1] < 1e-12 * singular[0]:
            return np.full((len(scale), len(scale)), np.inf)
        to = basis.T / singular / scale[:, None]
        return np.asarray(to @ to.T)

    @property
    def covariance(self) -> FloatArray:
        """(n, n), of the parameters, such that 3 sigma hold 99.7 % of errors."""
        return self.cofactors * self.covering_variance

    @cached_property
    def gain(self) -> FloatArray:
        """(n, 2 N), by which whitened errors of all points change the parameters; 0 for those that were not used."""
        rows = np.where(self.used[:, None, None], self.jacobian, 0)
        return np.asarray(self.cofactors @ rows.reshape(-1, self.problem.parameters).T)

    @cached_property
    def redundancies(self) -> FloatArray:
        """(N, 2, 2), the share of an error of each used point that shows in its own residual; of others I."""
        J = self.jacobian
        seen = np.eye(2) - J @ np.where(np.isfinite(self.cofactors), self.cofactors, 0) @ np.swapaxes(J, 1, 2)
        return np.asarray(np.where(self.used[:, None, None], seen, np.eye(2)))

    @property
    def _zero(self) -> FloatArray:
        return np.zeros(self.problem.parameters)


def solved(problem: Movable, used: BoolArray, noise: PointNoise) -> Solution[Movable]:
    """The least-squares solution nearest to the problem's present state.

    Args:
        problem: at its start.
        used: (N,) bool, the points that count.
        noise: of the points; weights are those at the start, and, where the ground is noisy, at a first solution.
    """
    for _ in range(2 if noise.ground_m > 0 else 1):
        problem = problem.moved(_minimised(problem, used, noise))
    return Solution(problem, used, noise)


def _minimised(problem: Problem, used: BoolArray, noise: PointNoise) -> FloatArray:
    W = noise.whitening(problem.ground_jacobian())[used]
    observed = problem.observed_px[used]

    def residuals(x: FloatArray) -> FloatArray:
        errors = np.einsum("nij,nj->ni", W, problem.predicted_px(x)[used] - observed)
        rows = np.concatenate([errors.ravel(), problem.prior(x)[0]])
        return np.asarray(np.nan_to_num(rows, nan=_HUGE_PX, posinf=_HUGE_PX, neginf=-_HUGE_PX))

    def derivative(x: FloatArray) -> FloatArray:
        rows = (W @ problem.jacobian(x)[used]).reshape(-1, problem.parameters)
        return np.asarray(np.nan_to_num(np.concatenate([rows, problem.prior(x)[1]]), posinf=0.0, neginf=0.0))

    start = np.zeros(problem.parameters)
    found = least_squares(residuals, start, derivative, x_scale="jac", method="lm", max_nfev=_EVALUATIONS, xtol=1e-10,
                          ftol=1e-10, gtol=1e-10)
    return np.asarray(found.x)
