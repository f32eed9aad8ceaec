"""From correspondences to a homography: least squares, RANSAC, MAGSAC++; every one with every model.

A residual counts in px along the directions in which its feature is well determined:
r^2 = e^T (Omega / lambda_max(Omega)) e, e the reference-side error, Omega the feature's information; so a patch on an
edge says nothing about motion along the edge. The robust estimators share one search (samples drawn and scored,
the best one polished: LO-RANSAC, Chum et al. 2003) and differ only in how a residual counts (`Kernel`):

* RANSAC (Fischler and Bolles 1981): 1 within the threshold, 0 beyond.
* MAGSAC++ (Barath et al. 2020, eq. 4 to 8): the likelihood marginalised over the noise scale up to its maximum,
  w(r) = Gamma((n-1)/2, r^2 / (2 s^2)) - Gamma((n-1)/2, k^2 / 2) with n = 2 error dimensions and k^2 the 99 % quantile
  of chi-square; the threshold is k s.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numba
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.models import PARAMETERS, Basis, minimal_homographies, minimal_points, nearest
from stab_ros.core.types import Correspondences, Fit, FloatArray, Homography, IdArray

_CONFIDENCE = 0.999
_MAX_SAMPLES = 500
_BATCH = 50
_POLISH = 10
_CONVERGED_PX = 1e-4
_TABLE = 1024  # steps of r^2 / threshold^2
_LEAST_TRUST = 0.1  # a feature trusted less is no inlier, wherever it lies
_SEED = 20201020


@dataclass(frozen=True, eq=False)
class Kernel:
    """How a residual counts: `weight` and `loss` over r^2 / threshold^2 in [0, 1]; beyond, 0 and 1."""

    weight: FloatArray
    loss: FloatArray
    searches: bool

    @staticmethod
    def least_squares() -> Kernel:
        return Kernel(np.ones(_TABLE), np.linspace(0, 1, _TABLE), searches=False)

    @staticmethod
    def ransac() -> Kernel:
        return Kernel(np.ones(_TABLE), np.zeros(_TABLE), searches=True)

    @staticmethod
    def magsac() -> Kernel:
        k2 = 2 * math.log(100)  # 99 % quantile of chi-square with 2 degrees of freedom
        squared = np.linspace(0, 1, _TABLE)
        upper = np.array([math.erfc(math.sqrt(t * k2 / 2)) for t in squared])  # Gamma(1/2, x) / sqrt(pi)
        weight = (upper - upper[-1]) / (upper[0] - upper[-1])
        loss = np.concatenate([[0.0], np.cumsum((weight[1:] + weight[:-1]) / 2)])
        return Kernel(weight, loss / loss[-1], searches=True)


ESTIMATORS = {"least_squares": Kernel.least_squares(), "ransac": Kernel.ransac(), "magsac": Kernel.magsac()}


@dataclass(frozen=True, eq=False)
class Problem:
    """Correspondences with what the estimators need of them, computed once.

    shape: (N, 2, 2) information over its largest eigenvalue. trust: (N,) in [0, 1], prior weight of each feature.
    """

    pairs: Correspondences
    shape: FloatArray
    trust: FloatArray
    basis: Basis
    threshold_px: float

    @staticmethod
    def of(pairs: Correspondences, trust: FloatArray, model: str, threshold_px: float) -> Problem:
        strongest = np.linalg.eigvalsh(pairs.information)[:, 1]
        shape = pairs.information / strongest[:, None, None]
        return Problem(pairs, shape, trust, Basis.around(model, pairs.reference_px), threshold_px)

    def squared(self, H: Homography) -> FloatArray:
        """Squared residuals over the squared threshold, (N,)."""
        return np.asarray(_squared(H, self.pairs.reference_px, self.pairs.current_px, self.shape)) / self.threshold_px**2


def fit(pairs: Correspondences, model: str, estimator: str, threshold_px: float, guess: Homography,
        trust: FloatArray | None = None) -> Fit | None:
    """The homography of `model` that the correspondences agree on; None if they do not determine one.

    guess: where to start from. trust: (N,) prior weights in [0, 1].
    """
    if len(pairs) < minimal_points(model):
        return None
    problem = Problem.of(pairs, np.ones(len(pairs)) if trust is None else trust, model, threshold_px)
    kernel = ESTIMATORS[estimator]
    guess = nearest(model, guess, pairs.current_px)
    H = _search(problem, kernel, guess) if kernel.searches else _polish(problem, kernel, guess, _POLISH)
    return None if H is None else _report(problem, kernel, H)


def refine(pairs: Correspondences, model: str, threshold_px: float, guess: Homography,
           trust: FloatArray) -> Homography | None:
    """What `fit` does from the guess alone, for the inner iterations of a method that re-measures after each."""
    if len(pairs) < minimal_points(model):
        return None
    return _narrow_down(Problem.of(pairs, trust, model, threshold_px), ESTIMATORS["magsac"], guess)


def _search(problem: Problem, kernel: Kernel, guess: Homography) -> Homography | None:
    """LO-RANSAC: the best of the narrowed-down guess and of polished samples, drawn until one more cannot matter."""
    best = _narrow_down(problem, kernel, guess)
    least = math.inf if best is None else _loss(problem, kernel, best)
    drawn = 0
    for samples in _samples(problem):
        if drawn >= _samples_needed(problem, least):
            break
        drawn += len(samples)
        polished = _polish(problem, kernel, _best_sample(problem, kernel, samples), _POLISH)
        if polished is not None and _loss(problem, kernel, polished) < least:
            best, least = polished, _loss(problem, kernel, polished)
    return best


def _narrow_down(problem: Problem, kernel: Kernel, guess: Homography) -> Homography | None:
    """From the guess through ever smaller thresholds (graduated non-convexity), for a guess that is a few px off."""
    H: Homography | None = guess
    for factor in (64.0, 16.0, 4.0, 1.0):
        wide = dataclasses.replace(problem, threshold_px=problem.threshold_px * factor)
        H = _polish(wide, kernel, H, _POLISH)
    return H


def _samples(problem: Problem) -> Iterator[IdArray]:
    """Batches of minimal samples, (_BATCH, n) indices, trusted features before all; the same ones at every call."""
    draw = np.random.default_rng(_SEED)
    n = minimal_points(problem.basis.model)
    pool = np.flatnonzero(problem.trust > 0.5)
    pool = pool if len(pool) >= 2 * n else np.arange(len(problem.pairs))
    for _ in range(_MAX_SAMPLES // _BATCH):
        samples = pool[draw.integers(0, len(pool), (_BATCH, n))]
        yield samples[[len(set(row)) == n for row in samples.tolist()]]


def _samples_needed(problem: Problem, loss: float) -> float:
    """Until one sample without an outlier was drawn with _CONFIDENCE; `loss` stands for the share of outliers."""
    if not math.isfinite(loss):
        return math.inf
    clean = max(1e-9, 1.0 - loss / float(problem.trust.sum())) ** minimal_points(problem.basis.model)
    return 0.0 if clean >= 1.0 else math.log(1 - _CONFIDENCE) / math.log(1 - clean)


def _best_sample(problem: Problem, kernel: Kernel, samples: IdArray) -> Homography | None:
    pairs = problem.pairs
    candidates = minimal_homographies(problem.basis.model, pairs.current_px[samples], pairs.reference_px[samples])
    if not len(candidates):
        return None
    losses = [_loss(problem, kernel, H) for H in candidates]
    return np.asarray(candidates[int(np.argmin(losses))])


def _polish(problem: Problem, kernel: Kernel, H: Homography | None, steps: int) -> Homography | None:
    """Iteratively re-weighted Gauss-Newton from H; None where the features that count do not determine the model."""
    for _ in range(steps):
        if H is None:
            return None
        weight = _agreement(problem, kernel, H) * problem.trust
        delta = _solve(*_normal_equations(problem, weight, H))
        if delta is None:
            return None
        H = problem.basis.compose(delta, H)
        if float(np.abs(delta).max()) < _CONVERGED_PX:
            break
    return H


def _agreement(problem: Problem, kernel: Kernel, H: Homography) -> FloatArray:
    """(N,) in [0, 1]: the kernel's weight of each residual; least squares knows no threshold."""
    squared = problem.squared(H)
    weight = kernel.weight[np.minimum(squared * (_TABLE - 1), _TABLE - 1).astype(np.int64)]
    return np.asarray(np.where((squared < 1) | (not kernel.searches), weight, 0.0))


def _loss(problem: Problem, kernel: Kernel, H: Homography) -> float:
    pairs = problem.pairs
    return float(_total_loss(H, pairs.reference_px, pairs.current_px, problem.shape, problem.trust,
                             kernel.loss, problem.threshold_px**-2))


def _normal_equations(problem: Problem, weight: FloatArray, H: Homography) -> tuple[FloatArray, FloatArray]:
    """Sum of w J^T Omega J and of w J^T Omega e over the features."""
    pairs, basis = problem.pairs, problem.basis
    return _accumulate(H, pairs.reference_px, pairs.current_px, pairs.information, weight,  # type: ignore[no-any-return]
                       basis.centre, basis.radius, PARAMETERS[basis.model])


def _solve(normal: FloatArray, right: FloatArray) -> FloatArray | None:
    """The step, or None where `normal` is singular."""
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0).all():
        return None
    conditioned = normal / np.outer(scale, scale)
    if np.linalg.eigvalsh(conditioned)[0] < 1e-10:
        return None
    return np.asarray(np.linalg.solve(conditioned, right / scale) / scale)


def _report(problem: Problem, kernel: Kernel, H: Homography) -> Fit | None:
    agreement = _agreement(problem, kernel, H)
    inlier = (problem.squared(H) < 1) & (problem.trust > _LEAST_TRUST)
    covariance = _covariance(problem, agreement * problem.trust, H)
    if covariance is None or not inlier.any():
        return None
    distance = np.sum((problem.pairs.reference_px - apply(H, problem.pairs.current_px)) ** 2, axis=1)
    return Fit(H, inlier, agreement, covariance, float(np.sqrt(np.mean(distance[inlier]))))


def _covariance(problem: Problem, weight: FloatArray, H: Homography) -> FloatArray | None:
    """Sandwich estimate N^-1 (sum w^2 J^T Omega e e^T Omega J) N^-1, at least N^-1, in entries of H (8, 8).

    The sandwich (Huber 1967) lets the residuals themselves say how far the claimed information may be believed.
    """
    normal, right = _normal_equations(problem, weight, H)
    if _solve(normal, right) is None:
        return None
    mapped = apply(H, problem.pairs.current_px)
    weighted_e = np.einsum("n,nij,nj->ni", weight, problem.pairs.information, problem.pairs.reference_px - mapped)
    score = np.einsum("nik,ni->nk", problem.basis.motions(mapped), weighted_e)
    inverse = np.linalg.inv(normal)
    sandwich = inverse @ (score.T @ score) @ inverse
    excess = max(1.0, float(np.trace(sandwich @ normal)) / len(normal))
    to_entries = problem.basis.entry_jacobian(H)
    return np.asarray(to_entries @ (inverse * excess) @ to_entries.T)


@numba.njit(cache=True, nogil=True)
def _accumulate(H: FloatArray, reference: FloatArray, current: FloatArray, information: FloatArray, weight: FloatArray,
                centre: FloatArray, radius: float, k: int) -> tuple[FloatArray, FloatArray]:
    """`_normal_equations` in one pass; its motions are those of `Basis.motions`."""
    normal, right = np.zeros((k, k)), np.zeros(k)
    along_x, along_y, weighted_x, weighted_y = np.empty(8), np.empty(8), np.empty(8), np.empty(8)
    for i in range(len(current)):
        if weight[i] <= 0:
            continue
        w = H[2, 0] * current[i, 0] + H[2, 1] * current[i, 1] + H[2, 2]
        mapped_x = (H[0, 0] * current[i, 0] + H[0, 1] * current[i, 1] + H[0, 2]) / w
        mapped_y = (H[1, 0] * current[i, 0] + H[1, 1] * current[i, 1] + H[1, 2]) / w
        x, y = (mapped_x - centre[0]) / radius, (mapped_y - centre[1]) / radius
        along_x[0], along_x[1], along_x[2], along_x[3] = 1.0, 0.0, -y, x
        along_x[4], along_x[5], along_x[6], along_x[7] = x, y, x * x, x * y
        along_y[0], along_y[1], along_y[2], along_y[3] = 0.0, 1.0, x, y
        along_y[4], along_y[5], along_y[6], along_y[7] = -y, x, x * y, y * y
        xx, xy = weight[i] * information[i, 0, 0], weight[i] * information[i, 0, 1]
        yy = weight[i] * information[i, 1, 1]
        ex, ey = reference[i, 0] - mapped_x, reference[i, 1] - mapped_y
        for a in range(k):
            weighted_x[a] = xx * along_x[a] + xy * along_y[a]
            weighted_y[a] = xy * along_x[a] + yy * along_y[a]
            right[a] += weighted_x[a] * ex + weighted_y[a] * ey
            for b in range(a + 1):
                normal[a, b] += weighted_x[a] * along_x[b] + weighted_y[a] * along_y[b]
    for a in range(k):
        for b in range(a):
            normal[b, a] = normal[a, b]
    return normal, right


@numba.njit(cache=True, nogil=True)
def _squared(H: FloatArray, reference: FloatArray, current: FloatArray, shape: FloatArray) -> FloatArray:
    """Squared residual of every feature, px^2."""
    out = np.empty(len(current))
    for i in range(len(current)):
        x, y = current[i, 0], current[i, 1]
        w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        ex = reference[i, 0] - (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w
        ey = reference[i, 1] - (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
        out[i] = ex * ex * shape[i, 0, 0] + 2 * ex * ey * shape[i, 0, 1] + ey * ey * shape[i, 1, 1]
    return out


@numba.njit(cache=True, nogil=True)
def _total_loss(H: FloatArray, reference: FloatArray, current: FloatArray, shape: FloatArray, trust: FloatArray,
                table: FloatArray, per_squared_px: float) -> float:
    """Sum of the trust-weighted losses; a feature beyond the threshold counts 1."""
    squared = _squared(H, reference, current, shape)
    total, last = 0.0, len(table) - 1
    for i in range(len(squared)):
        t = squared[i] * per_squared_px
        total += trust[i] * (table[int(t * last)] if t < 1 else 1.0)
    return total
