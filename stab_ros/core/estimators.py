"""From correspondences to a homography: least squares, RANSAC, MAGSAC++; every one with every model.

A residual counts in px along the directions in which its feature is well determined:
r^2 = e^T (Omega / lambda_max(Omega)) e, e the reference-side error, Omega the feature's information; so a patch on an
edge says nothing about motion along the edge. The robust estimators share one search (samples drawn and scored,
the best one polished: LO-RANSAC, Chum et al. 2003) and differ only in how a residual counts (`Kernel`):

* RANSAC (Fischler and Bolles 1981): 1 within the threshold, 0 beyond.
* MAGSAC++ (Barath et al. 2020, eq. 4 to 8): the likelihood marginalised over the noise scale up to its maximum,
  w(r) = Gamma((n-1)/2, r^2 / (2 s^2)) - Gamma((n-1)/2, k^2 / 2) with n = 4 coordinates of a correspondence and k^2 the
  99 % quantile of chi-square; the threshold is k s.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stab_ros.core import _gauss_newton as gn
from stab_ros.core.geometry import apply
from stab_ros.core.models import PARAMETERS, Basis, minimal_homographies, minimal_points, nearest
from stab_ros.core.types import Correspondences, Fit, FloatArray, Homography, IdArray

_CONFIDENCE = 0.999
_MAX_SAMPLES = 500
_BATCH = 50
_POLISH = 10
_CONVERGED_PX = 1e-3
_OCTAVES = 4
_LEVEL = 0.2  # of the threshold: features more certain than this count alike in the search
_SETTLING = 2
_SIGMAS = 3.0  # of a feature's own noise that are no disagreement
_MAJORITY = 0.8
_CHI2_4_99 = 13.277  # 99 % quantile of chi-square with 4 degrees of freedom
_TABLE = 4096  # steps of r^2 / threshold^2
_TRUSTED = 0.5  # samples are drawn among features trusted more
_SEED = 20201020


@dataclass(frozen=True, eq=False)
class Kernel:
    """How a residual counts: `weight` and `loss` over r^2 / limit^2 in [0, 1]; from there on, `beyond` and 1."""

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


ESTIMATORS = {"least_squares": Kernel.least_squares(), "ransac": Kernel.ransac(), "magsac": Kernel.magsac()}


@dataclass(frozen=True, eq=False)
class Problem:
    """Correspondences with what the estimators need of them, computed once.

    shape: (N, 2, 2) information over its largest eigenvalue. trust: (N,) in [0, 1], prior weight of each feature.
    noise: (N,) px^2, what a feature's own uncertainty adds to the square of any threshold.
    """

    pairs: Correspondences
    shape: FloatArray
    trust: FloatArray
    noise: FloatArray
    basis: Basis
    threshold_px: float

    @staticmethod
    def of(pairs: Correspondences, trust: FloatArray, model: str, threshold_px: float) -> Problem:
        strength = strongest(pairs.information)
        shape, noise = pairs.information / strength[:, None, None], _SIGMAS**2 / strength
        return Problem(pairs, shape, trust, noise, Basis.around(model, pairs.reference_px), threshold_px)

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

    def relief_px(self, H: Homography) -> float:
        """How far trusted features scatter beyond their own noise: relief of the ground, compression, leaves.

        A robust moment estimate of the between-feature spread in a random-effects model (DerSimonian and Laird 1986),
        from the more certain half of the features, each along its best direction.
        """
        chosen = (self.relative(H, self.threshold_px) < 1) & (self.trust > _TRUSTED)
        if not chosen.any():
            return 0.0
        pairs = self.pairs
        variance, claimed = gn.variances_along(H, pairs.reference_px, pairs.current_px, pairs.information, chosen)
        return math.sqrt(max(0.0, variance - claimed))

    def typical_px(self, H: Homography) -> float:
        """Median residual of the trusted features, px; infinite where there are none."""
        pairs = self.pairs
        return float(gn.typical_residual(H, pairs.reference_px, pairs.current_px, self.shape, self.trust > _TRUSTED))

    def agreeing(self, H: Homography) -> float:
        """Share of the trust that lies close to H: within a quarter of the threshold, and its own noise."""
        close = self.relative(H, self.threshold_px / 4) < 1
        return float(np.sum(self.trust[close])) / max(float(np.sum(self.trust)), 1e-9)

    def reach_px(self, kernel: Kernel, H: Homography) -> float:
        """How far from H a feature without noise still counts: four times the relief, at most the threshold."""
        if not kernel.robust:
            return self.threshold_px
        return min(max(4 * self.relief_px(H), self.threshold_px * 0.5 ** (_OCTAVES - 1)), self.threshold_px)

    def least_loss(self, kernel: Kernel, candidates: FloatArray) -> tuple[int, float]:
        """The best of (M, 3, 3) candidates (-1: there are none) and its loss."""
        pairs = self.pairs
        best, loss = gn.least_loss(candidates, pairs.reference_px, pairs.current_px, self.shape, self.trust, self.noise,
                                   kernel.loss, self.threshold_px, _OCTAVES)
        return int(best), float(loss)

    def polish(self, kernel: Kernel, H: Homography, threshold_px: float, steps: int = _POLISH) -> Homography | None:
        """Iteratively re-weighted Gauss-Newton from H; None where the features that count determine nothing."""
        pairs, basis = self.pairs, self.basis
        found, polished = gn.polish(H, pairs.reference_px, pairs.current_px, pairs.information, self.shape, self.trust,
                                    self.noise, kernel.weight, kernel.beyond, threshold_px, basis.centre,
                                    basis.radius, PARAMETERS[basis.model], steps, _CONVERGED_PX)
        return polished if found else None


def fit(pairs: Correspondences, model: str, estimator: str, threshold_px: float, guess: Homography,
        trust: FloatArray | None = None) -> Fit | None:
    """The homography of `model` that the correspondences agree on; None if they do not determine one.

    guess: where to start from. trust: (N,) prior weights in [0, 1].
    """
    if len(pairs) < minimal_points(model):
        return None
    kernel = ESTIMATORS[estimator]
    problem = Problem.of(pairs, np.ones(len(pairs)) if trust is None else trust, model, threshold_px)
    H = _search(problem, kernel, nearest(model, guess, pairs.current_px))
    if H is None:
        return None
    reach_px = problem.reach_px(kernel, H)
    problem = problem.softened(problem.relief_px(H))
    H = problem.polish(kernel, H, reach_px)
    return None if H is None else _report(problem, kernel, H, reach_px)


def refine(pairs: Correspondences, model: str, threshold_px: float, guess: Homography,
           trust: FloatArray) -> Homography | None:
    """The homography alone, good enough for the inner iterations of a method that measures again after each."""
    if len(pairs) < minimal_points(model):
        return None
    return _search(Problem.of(pairs, trust, model, threshold_px), ESTIMATORS["magsac"], guess)


def strongest(information: FloatArray) -> FloatArray:
    """The larger eigenvalue of each of (N, 2, 2): (N,)."""
    xx, xy, yy = information[:, 0, 0], information[:, 0, 1], information[:, 1, 1]
    return np.asarray((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))


def _search(problem: Problem, kernel: Kernel, guess: Homography) -> Homography | None:
    """LO-RANSAC: the best of the narrowed-down guess and of polished samples, drawn until one more cannot matter.

    No feature may outvote many others here: the information is levelled to a fraction of the threshold.
    """
    problem = problem.softened(_LEVEL * problem.threshold_px)
    if not kernel.robust:
        return problem.polish(kernel, guess, problem.threshold_px)
    best = _narrow_down(problem, kernel, guess)
    least = math.inf if best is None else problem.least_loss(kernel, best[None])[1]
    if best is not None and problem.agreeing(best) > _MAJORITY:
        return best  # no other plane can have more
    drawn = 0
    for samples in _samples(problem):
        if drawn >= _samples_needed(problem, least):
            break
        drawn += len(samples)
        candidate = _polished_sample(problem, kernel, samples)
        loss = math.inf if candidate is None else problem.least_loss(kernel, candidate[None])[1]
        if loss < least:
            best, least = candidate, loss
    return best


def _narrow_down(problem: Problem, kernel: Kernel, guess: Homography) -> Homography | None:
    """From the guess through ever smaller thresholds (graduated non-convexity), for a guess that is a few px off."""
    H: Homography | None = guess
    reach_px = 3 * problem.typical_px(guess)
    while problem.threshold_px < reach_px < math.inf and H is not None:
        H = problem.polish(kernel, H, reach_px, steps=2)
        reach_px /= 4
    return _settle(problem, kernel, H)


def _settle(problem: Problem, kernel: Kernel, H: Homography | None) -> Homography | None:
    """H fitted to what lies within the scatter of what agrees with it."""
    for _ in range(_SETTLING):
        H = None if H is None else problem.polish(kernel, H, problem.reach_px(kernel, H))
    return H


def _samples(problem: Problem) -> Iterator[IdArray]:
    """Batches of minimal samples, (_BATCH, n) indices, of trusted features where there are; the same at every call."""
    draw = np.random.default_rng(_SEED)
    n = minimal_points(problem.basis.model)
    pool = np.flatnonzero(problem.trust > _TRUSTED)
    pool = pool if len(pool) >= 2 * n else np.arange(len(problem.pairs))
    for _ in range(_MAX_SAMPLES // _BATCH):
        samples = pool[draw.integers(0, len(pool), (_BATCH, n))]
        yield samples[[len(set(row)) == n for row in samples.tolist()]]


def _samples_needed(problem: Problem, loss: float) -> float:
    """Until one sample without an outlier was drawn with _CONFIDENCE; `loss` stands for the share of outliers."""
    agreeing = 1.0 - loss / max(float(problem.trust.sum()), 1e-9)
    clean = min(max(1e-3, agreeing), 1 - 1e-9) ** minimal_points(problem.basis.model)
    return math.log(1 - _CONFIDENCE) / math.log(1 - clean)


def _polished_sample(problem: Problem, kernel: Kernel, samples: IdArray) -> Homography | None:
    """The best of the samples' homographies, then fitted to all that agrees with it."""
    pairs = problem.pairs
    candidates = minimal_homographies(problem.basis.model, pairs.current_px[samples], pairs.reference_px[samples])
    best = problem.least_loss(kernel, candidates)[0]
    return None if best < 0 else _settle(problem, kernel, candidates[best])


def _report(problem: Problem, kernel: Kernel, H: Homography, reach_px: float) -> Fit | None:
    relative = problem.relative(H, reach_px)
    inlier = relative < 1
    covariance = _covariance(problem, gn.weigh(relative, kernel.weight, kernel.beyond) * problem.trust, H)
    if covariance is None or not inlier.any():
        return None
    distance = np.sum((problem.pairs.reference_px - apply(H, problem.pairs.current_px)) ** 2, axis=1)
    return Fit(H, inlier, covariance, float(np.sqrt(np.mean(distance[inlier]))))


def _covariance(problem: Problem, weight: FloatArray, H: Homography) -> FloatArray | None:
    """Of the entries of H (8, 8): the sandwich N^-1 V N^-1 of a weighted fit (Huber 1967).

    V is the variance of the score that the information claims, inflated where the residuals show more of it.
    """
    pairs, basis = problem.pairs, problem.basis
    normal, right, claimed, shown = gn.accumulate(H, pairs.reference_px, pairs.current_px, pairs.information, weight,
                                                  basis.centre, basis.radius, PARAMETERS[basis.model])
    if not gn.solve(normal, right)[0]:
        return None
    inverse = np.linalg.inv(normal)
    excess = max(1.0, float(np.trace(inverse @ shown)) / float(np.trace(inverse @ claimed)))
    to_entries = basis.entry_jacobian(H) @ inverse
    return np.asarray(to_entries @ (claimed * excess) @ to_entries.T)
