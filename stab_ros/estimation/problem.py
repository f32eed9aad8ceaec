"""What every estimator works on: correspondences with what is needed of them, and how a residual counts.

A residual counts in px along the directions in which its feature is well determined:
r^2 = e^T (Omega / lambda_max(Omega)) e, e the reference-side error, Omega the feature's information; so a patch on an
edge says nothing about motion along the edge.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Homography
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.models import PARAMETERS, Basis

RANSAC_THRESHOLD_PX = 3.0
TRUSTED = 0.5  # samples are drawn among features trusted more
_POLISH = 10
_CONVERGED_PX = 1e-3
_OCTAVES = 4
_SIGMAS = 3.0  # of a feature's own noise that are no disagreement
_CHI2_4_99 = 13.277  # 99 % quantile of chi-square with 4 degrees of freedom
_TABLE = 4096  # steps of r^2 / threshold^2


@dataclass(frozen=True, eq=False)
class Kernel:
    """How a residual counts: `weight` and `loss` over r^2 / limit^2 in [0, 1]; from there on, `beyond` and 1.

    * RANSAC (Fischler and Bolles 1981): 1 within the threshold, 0 beyond.
    * MAGSAC++ (Barath et al. 2020, eq. 4 to 8): the likelihood marginalised over the noise scale up to its maximum,
      w(r) = Gamma((n-1)/2, r^2 / (2 s^2)) - Gamma((n-1)/2, k^2 / 2) with n = 4 coordinates of a correspondence and k^2
      the 99 % quantile of chi-square; the threshold is k s.
    """

    weight: FloatArray
    loss: FloatArray
    beyond: float
    robust: bool

    @staticmethod
    def least_squares() -> Kernel:
        return Kernel(np.ones(_TABLE), np.linspace(0, 1, _TABLE), beyond=1.0, robust=False)

    @staticmethod
    def ransac() -> Kernel:
        return Kernel(np.ones(_TABLE), np.zeros(_TABLE), beyond=0.0, robust=True)

    @staticmethod
    def magsac() -> Kernel:
        x = np.linspace(0, 1, _TABLE) * _CHI2_4_99 / 2
        upper = np.array([math.erfc(math.sqrt(t)) + 2 * math.sqrt(t / math.pi) * math.exp(-t) for t in x])
        weight = (upper - upper[-1]) / (upper[0] - upper[-1])
        loss = np.concatenate([[0.0], np.cumsum((weight[1:] + weight[:-1]) / 2)])
        return Kernel(weight, loss / loss[-1], beyond=0.0, robust=True)


LEAST_SQUARES, RANSAC, MAGSAC = Kernel.least_squares(), Kernel.ransac(), Kernel.magsac()


@dataclass(frozen=True, eq=False)
class Problem:
    """Correspondences with what the estimators need of them, computed once.

    shape: (N, 2, 2) information over its largest eigenvalue. trust: (N,) in [0, 1], prior weight of each feature.
    noise: (N,) px^2, what a feature's own uncertainty adds to the square of any threshold.
    ransac_threshold_px: of the consensus that ED-RANSAC filters.
    """

    pairs: Correspondences
    shape: FloatArray
    trust: FloatArray
    noise: FloatArray
    basis: Basis
    threshold_px: float
    ransac_threshold_px: float

    @staticmethod
    def of(pairs: Correspondences, trust: FloatArray, model: str, threshold_px: float,
           ransac_threshold_px: float = RANSAC_THRESHOLD_PX) -> Problem:
        strength = strongest(pairs.information)
        shape, noise = pairs.information / strength[:, None, None], own_noise(strength)
        basis = Basis.around(model, pairs.reference_px)
        return Problem(pairs, shape, trust, noise, basis, threshold_px, ransac_threshold_px)

    def only(self, chosen: BoolArray) -> Problem:
        """The same features, of which none but the chosen are trusted."""
        return dataclasses.replace(self, trust=np.where(chosen, self.trust, 0.0))

    def euclidean(self) -> Problem:
        """The same features with plain distances for residuals, and without an allowance for their own noise."""
        n = len(self.pairs)
        return dataclasses.replace(self, shape=np.tile(np.eye(2), (n, 1, 1)), noise=np.zeros(n))

    def softened(self, sigma_px: float) -> Problem:
        """The same features with an independent error of `sigma_px` more each: (Omega^-1 + sigma^2 I)^-1."""
        information, variance = self.pairs.information, sigma_px**2
        trace = information[:, 0, 0] + information[:, 1, 1]
        det = information[:, 0, 0] * information[:, 1, 1] - information[:, 0, 1] ** 2
        softer = information + (variance * det)[:, None, None] * np.eye(2)  # 2x2: adj(A + B) = adj(A) + adj(B)
        softer /= (1 + variance * trace + variance**2 * det)[:, None, None]
        return dataclasses.replace(self, pairs=dataclasses.replace(self.pairs, information=softer))

    def relative(self, H: Homography, threshold_px: float) -> FloatArray:
        """Squared residuals over the squared limits, (N,): an inlier is below 1."""
        pairs = self.pairs
        squared = gn.squared_residuals(H, pairs.reference_px, pairs.current_px, self.shape)
        return np.asarray(squared / (threshold_px**2 + self.noise))

    def relief_px(self, H: Homography, reach_px: float | None = None) -> float:
        """How far trusted features scatter beyond their own noise: relief of the ground, compression, leaves.

        A robust moment estimate of the between-feature spread in a random-effects model (DerSimonian and Laird 1986),
        from the more certain half of the features within `reach_px` (the threshold), each along its best direction.
        """
        chosen = (self.relative(H, self.threshold_px if reach_px is None else reach_px) < 1) & (self.trust > TRUSTED)
        if not chosen.any():
            return 0.0
        pairs = self.pairs
        variance, claimed = gn.variances_along(H, pairs.reference_px, pairs.current_px, pairs.information, chosen)
        return math.sqrt(max(0.0, variance - claimed))

    def typical_px(self, H: Homography) -> float:
        """Median residual of the trusted features, px; infinite where there are none."""
        pairs = self.pairs
        return float(gn.typical_residual(H, pairs.reference_px, pairs.current_px, self.shape, self.trust > TRUSTED))

    def agreeing(self, H: Homography) -> float:
        """Share of the trust that lies close to H: within a quarter of the threshold, and its own noise."""
        close = self.relative(H, self.threshold_px / 4) < 1
        return float(np.sum(self.trust[close])) / max(float(np.sum(self.trust)), 1e-9)

    def reach_px(self, kernel: Kernel, H: Homography) -> float:
        """How far from H a feature without noise still counts: four times the relief, at most the threshold."""
        if not kernel.robust:
            return self.threshold_px
        return min(max(4 * self.relief_px(H), self.threshold_px * 0.5 ** (_OCTAVES - 1)), self.threshold_px)

    def least_loss(self, kernel: Kernel, candidates: FloatArray, threshold_px: float | None = None,
                   octaves: int = _OCTAVES) -> tuple[int, float]:
        """The best of (M, 3, 3) candidates (-1: there are none) and its loss."""
        pairs, reach_px = self.pairs, self.threshold_px if threshold_px is None else threshold_px
        best, loss = gn.least_loss(candidates, pairs.reference_px, pairs.current_px, self.shape, self.trust, self.noise,
                                   kernel.loss, reach_px, octaves)
        return int(best), float(loss)

    def polish(self, kernel: Kernel, H: Homography, threshold_px: float, steps: int = _POLISH) -> Homography | None:
        """Iteratively re-weighted Gauss-Newton from H; None where the features that count determine nothing."""
        pairs, basis = self.pairs, self.basis
        found, polished = gn.polish(H, pairs.reference_px, pairs.current_px, pairs.information, self.shape, self.trust,
                                    self.noise, kernel.weight, kernel.beyond, threshold_px, basis.centre,
                                    basis.radius, PARAMETERS[basis.model], steps, _CONVERGED_PX)
        return polished if found else None


def own_noise(strength: FloatArray) -> FloatArray:
    """(N,) px^2: what a feature's own uncertainty adds to the square of any threshold, by `strongest` of it."""
    return np.asarray(_SIGMAS**2 / strength)


def strongest(information: FloatArray) -> FloatArray:
    """The larger eigenvalue of each of (N, 2, 2): (N,)."""
    xx, xy, yy = information[:, 0, 0], information[:, 0, 1], information[:, 1, 1]
    return np.asarray((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))
