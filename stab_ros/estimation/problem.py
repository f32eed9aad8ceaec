"""The estimation problem: correspondences with their weights and noise, and the loss functions of the estimators.

Residuals are Mahalanobis distances scaled to px: r^2 = e^T (Omega / lambda_max(Omega)) e, where e is the reference-side
error and Omega the feature's information matrix. A patch on an edge therefore does not constrain motion along the edge.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Homography
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.clusters import ACROSS, cells_of
from stab_ros.estimation.models import PARAMETERS, Basis

RANSAC_THRESHOLD_PX = 3.0
TRUSTED = 0.5  # minimal samples are drawn from features with a larger prior weight
_MAX_STEPS = 10
_CONVERGED_PX = 1e-3
_OCTAVES = 4
_NOISE_SIGMAS = 3.0  # standard deviations of a feature's noise that are added to the inlier threshold
_CHI2_4_99 = 13.277  # 99 % quantile of chi-square with 4 degrees of freedom
_CHI2_2_END = 40.0  # what lies beyond does not count
_MIXED = 0.25
_TABLE_SIZE = 4096  # samples of r^2 / threshold^2


@dataclass(frozen=True, eq=False)
class LossFunction:
    """A loss function of the squared ratio r^2 / limit^2, tabulated over [0, 1].

    * RANSAC (Fischler and Bolles 1981): weight 1 within the threshold, 0 outside.
    * MAGSAC++ (Barath et al. 2020, eq. 4 to 8): the likelihood marginalized over the noise scale up to its maximum,
      w(r) = Gamma((n-1)/2, r^2 / (2 s^2)) - Gamma((n-1)/2, k^2 / 2) with n = 4 coordinates of a correspondence and k^2
      the 99 % quantile of chi-square; the threshold is k s.

    Attributes:
        weight: (4096,) IRLS weight.
        loss: (4096,) loss, 0 to 1; it is 1 for larger ratios.
        beyond: weight for larger ratios.
        robust: whether it needs a search with minimal samples.
    """

    weight: FloatArray
    loss: FloatArray
    beyond: float
    robust: bool

    @property
    def falls(self) -> bool:
        """Whether the weight falls to nothing at the threshold."""
        return bool(self.weight[-1] == 0)

    @cached_property
    def claimed(self) -> FloatArray:
        """(4096,) E[w^2 q / 2], q chi-square with 2 degrees of freedom, where r^2 / limit^2 = s q; s from 0 to 1.

        The variance of w r for normal errors of variance s limit^2, as a share of that variance.
        """
        q = np.linspace(0, _CHI2_2_END, _TABLE_SIZE)
        density = np.exp(-q / 2) / np.exp(-q / 2).sum() * q / 2
        steps = np.linspace(0, 1, _TABLE_SIZE // 16)
        coarse = [float(density @ gn.weights_of(s * q, self.weight, self.beyond) ** 2) for s in steps]
        return np.interp(np.linspace(0, 1, _TABLE_SIZE), steps, coarse)

    @staticmethod
    def least_squares() -> LossFunction:
        return LossFunction(np.ones(_TABLE_SIZE), np.linspace(0, 1, _TABLE_SIZE), beyond=1.0, robust=False)

    @staticmethod
    def ransac() -> LossFunction:
        return LossFunction(np.ones(_TABLE_SIZE), np.zeros(_TABLE_SIZE), beyond=0.0, robust=True)

    @staticmethod
    def magsac() -> LossFunction:
        x = np.linspace(0, 1, _TABLE_SIZE) * _CHI2_4_99 / 2
        upper = np.array([math.erfc(math.sqrt(t)) + 2 * math.sqrt(t / math.pi) * math.exp(-t) for t in x])
        weight = (upper - upper[-1]) / (upper[0] - upper[-1])
        loss = np.concatenate([[0.0], np.cumsum((weight[1:] + weight[:-1]) / 2)])
        return LossFunction(weight, loss / loss[-1], beyond=0.0, robust=True)


LEAST_SQUARES, RANSAC, MAGSAC = LossFunction.least_squares(), LossFunction.ransac(), LossFunction.magsac()


@dataclass(frozen=True, eq=False)
class EstimationProblem:
    """Correspondences with the quantities that all estimators need.

    Attributes:
        pairs: N correspondences.
        metric: (N, 2, 2) information matrices divided by their largest eigenvalues.
        trust: (N,) prior weights in [0, 1].
        noise: (N,) increase of the squared inlier threshold by each feature's uncertainty, px^2.
        basis: normalized coordinates of the model.
        threshold_px: inlier threshold.
        ransac_threshold_px: inlier threshold of the consensus set that ED-RANSAC filters.
    """

    pairs: Correspondences
    metric: FloatArray
    trust: FloatArray
    noise: FloatArray
    basis: Basis
    threshold_px: float
    ransac_threshold_px: float

    @staticmethod
    def of(pairs: Correspondences, trust: FloatArray, model: str, threshold_px: float,
           ransac_threshold_px: float = RANSAC_THRESHOLD_PX) -> EstimationProblem:
        strength = strongest(pairs.information)
        metric, noise = pairs.information / strength[:, None, None], own_noise(strength)
        basis = Basis.around(model, pairs.reference_px)
        return EstimationProblem(pairs, metric, trust, noise, basis, threshold_px, ransac_threshold_px)

    def restricted_to(self, chosen: BoolArray) -> EstimationProblem:
        """The same problem with prior weights of 0 for all but the chosen features, (N,) bool."""
        return dataclasses.replace(self, trust=np.where(chosen, self.trust, 0.0))

    def trusting_neighbours(self) -> EstimationProblem:
        """The same problem with larger prior weights where trusted features are mixed among others.

        The weight rises to 1 where a share of `_MIXED` of the features of a cell of the picture is trusted. Water has
        cells of its own; what does not follow the fit because rows swing or edges are blurred has not.
        """
        cell = cells_of(self.pairs.reference_px)
        count = np.bincount(cell, minlength=ACROSS**2)
        share = np.bincount(cell, self.trust, ACROSS**2) / np.maximum(count, 1)
        return dataclasses.replace(self, trust=np.maximum(self.trust, np.minimum(share / _MIXED, 1.0)[cell]))

    def wider(self, factor: float) -> EstimationProblem:
        """The same problem with `factor` times as many standard deviations added to the inlier threshold."""
        return dataclasses.replace(self, noise=self.noise * factor**2)

    def euclidean(self) -> EstimationProblem:
        """The same problem with Euclidean residuals and the same inlier threshold for all features."""
        n = len(self.pairs)
        return dataclasses.replace(self, metric=np.tile(np.eye(2), (n, 1, 1)), noise=np.zeros(n))

    def noise_inflated(self, sigma_px: float) -> EstimationProblem:
        """The same problem with an isotropic error added to each feature: information (Omega^-1 + sigma^2 I)^-1."""
        information, variance = self.pairs.information, sigma_px**2
        trace = information[:, 0, 0] + information[:, 1, 1]
        det = information[:, 0, 0] * information[:, 1, 1] - information[:, 0, 1] ** 2
        inflated = information + (variance * det)[:, None, None] * np.eye(2)  # 2x2: adj(A + B) = adj(A) + adj(B)
        inflated /= (1 + variance * trace + variance**2 * det)[:, None, None]
        return dataclasses.replace(self, pairs=dataclasses.replace(self.pairs, information=inflated))

    def squared_ratios(self, H: Homography, threshold_px: float) -> FloatArray:
        """Squared residuals divided by the squared inlier thresholds, (N,); inliers are below 1."""
        pairs = self.pairs
        squared = gn.squared_residuals(H, pairs.reference_px, pairs.current_px, self.metric)
        return np.asarray(squared / (threshold_px**2 + self.noise))

    def weights(self, loss_function: LossFunction, H: Homography, limit_px: float) -> FloatArray:
        """Weight (N,) of each feature in a fit: that of the loss function times the prior one."""
        ratios = self.squared_ratios(H, limit_px)
        return np.asarray(gn.weights_of(ratios, loss_function.weight, loss_function.beyond) * self.trust)

    def excess_scatter_px(self, H: Homography, limit_px: float | None = None) -> float:
        """Standard deviation of the residuals in excess of the features' noise, px: relief, compression, vegetation.

        A robust moment estimate of the between-feature variance in a random-effects model (DerSimonian and Laird 1986).
        It uses the more certain half of the trusted features within `limit_px` (default: the threshold), each along its
        axis of smallest uncertainty.
        """
        ratios = self.squared_ratios(H, self.threshold_px if limit_px is None else limit_px)
        chosen = (ratios < 1) & (self.trust > TRUSTED)
        if not chosen.any():
            return 0.0
        pairs = self.pairs
        variance, predicted = gn.variances_along_best_axis(H, pairs.reference_px, pairs.current_px, pairs.information,
                                                           chosen)
        return math.sqrt(max(0.0, variance - predicted))

    def median_residual_px(self, H: Homography) -> float:
        """Median residual of the trusted features, px; infinite if there are none."""
        pairs = self.pairs
        return float(gn.median_residual(H, pairs.reference_px, pairs.current_px, self.metric, self.trust > TRUSTED))

    def support(self, H: Homography) -> float:
        """Share of the total prior weight of features that agree with H within a quarter of the threshold."""
        supporting = self.squared_ratios(H, self.threshold_px / 4) < 1
        return float(np.sum(self.trust[supporting])) / max(float(np.sum(self.trust)), 1e-9)

    def inlier_threshold_px(self, loss_function: LossFunction, scatter_px: float) -> float:
        """Adaptive inlier threshold: four times the excess scatter, within [threshold / 8, threshold]."""
        if not loss_function.robust:
            return self.threshold_px
        return min(max(4 * scatter_px, self.threshold_px * 0.5 ** (_OCTAVES - 1)), self.threshold_px)

    def least_loss(self, loss_function: LossFunction, candidates: FloatArray, threshold_px: float | None = None,
                   octaves: int = _OCTAVES) -> tuple[int, float]:
        """Index of the candidate (M, 3, 3) with the smallest loss (-1 if there are none), and that loss."""
        pairs, limit_px = self.pairs, self.threshold_px if threshold_px is None else threshold_px
        best, loss = gn.least_loss(candidates, pairs.reference_px, pairs.current_px, self.metric, self.trust,
                                   self.noise, loss_function.loss, limit_px, octaves)
        return int(best), float(loss)

    def polish(self, loss_function: LossFunction, H: Homography, threshold_px: float,
               steps: int = _MAX_STEPS) -> Homography | None:
        """Iteratively reweighted Gauss-Newton from H; None where the weighted features determine no homography."""
        pairs, basis = self.pairs, self.basis
        found, polished = gn.polish(H, pairs.reference_px, pairs.current_px, pairs.information, self.metric, self.trust,
                                    self.noise, loss_function.weight, loss_function.beyond, threshold_px, basis.centre,
                                    basis.radius, PARAMETERS[basis.model], steps, _CONVERGED_PX)
        return polished if found else None


def own_noise(strength: FloatArray) -> FloatArray:
    """Increase (N,) of the squared inlier threshold by each feature's uncertainty, px^2: (3 sigma)^2.

    strength: (N,) `strongest` eigenvalue of each information matrix, 1/px^2.
    """
    return np.asarray(_NOISE_SIGMAS**2 / strength)


def strongest(information: FloatArray) -> FloatArray:
    """Larger eigenvalue (N,) of each symmetric matrix (N, 2, 2)."""
    xx, xy, yy = information[:, 0, 0], information[:, 0, 1], information[:, 1, 1]
    return np.asarray((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))
