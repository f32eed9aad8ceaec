"""Random minimal samples: drawing them, their homographies, and the number of samples required."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from stab_ros.core.types import FloatArray, Homography, IdArray
from stab_ros.estimation.models import minimal_homographies, minimal_points
from stab_ros.estimation.problem import TRUSTED, EstimationProblem

_CONFIDENCE = 0.999
_MAX_SAMPLES = 500
_BATCH = 50
_SEED = 20201020

# returns the best homography of candidates (M, 3, 3), or None, and its loss
Scorer = Callable[[FloatArray], tuple[Homography | None, float]]


def best_sample(problem: EstimationProblem, score: Scorer, required: Callable[[float], float],
                best: Homography | None = None, least: float = math.inf) -> Homography | None:
    """The homography with the smallest loss among `best` (with loss `least`) and those of random minimal samples.

    Samples are drawn until their number reaches `required(loss)` of the smallest loss so far.
    """
    drawn = 0
    for samples in _samples(problem):
        if drawn >= required(least):
            break
        drawn += len(samples)
        candidate, loss = score(_homographies_of(problem, samples))
        if loss < least:
            best, least = candidate, loss
    return best


def samples_needed(problem: EstimationProblem, outliers: float) -> float:
    """Number of samples for a probability of 0.999 that one is free of outliers, with a share `outliers` of them.

    Fischler and Bolles (1981); Hartley and Zisserman (2004), eq. 4.18.
    """
    clean = min(max(1e-3, 1.0 - outliers), 1 - 1e-9) ** minimal_points(problem.basis.model)
    return math.log(1 - _CONFIDENCE) / math.log(1 - clean)


def _samples(problem: EstimationProblem) -> Iterator[IdArray]:
    """Batches of minimal samples (_BATCH, n), indices of trusted features if there are enough; always the same."""
    draw = np.random.default_rng(_SEED)
    n = minimal_points(problem.basis.model)
    pool = np.flatnonzero(problem.trust > TRUSTED)
    pool = pool if len(pool) >= 2 * n else np.arange(len(problem.pairs))
    for _ in range(_MAX_SAMPLES // _BATCH):
        samples = pool[draw.integers(0, len(pool), (_BATCH, n))]
        yield samples[[len(set(row)) == n for row in samples.tolist()]]


def _homographies_of(problem: EstimationProblem, samples: IdArray) -> FloatArray:
    """Homographies (M, 3, 3) of the samples."""
    pairs = problem.pairs
    return minimal_homographies(problem.basis.model, pairs.current_px[samples], pairs.reference_px[samples])
