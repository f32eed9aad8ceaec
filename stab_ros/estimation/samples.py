"""Minimal samples: drawn, solved, and how many of them are enough."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from stab_ros.core.types import FloatArray, Homography, IdArray
from stab_ros.estimation.models import minimal_homographies, minimal_points
from stab_ros.estimation.problem import TRUSTED, Problem

_CONFIDENCE = 0.999
_MAX_SAMPLES = 500
_BATCH = 50
_SEED = 20201020

# the best homography of (M, 3, 3) candidates (None: there is none), and its loss
Judge = Callable[[FloatArray], tuple[Homography | None, float]]


def best_drawn(problem: Problem, judge: Judge, needed: Callable[[float], float], best: Homography | None = None,
               least: float = math.inf) -> Homography | None:
    """What has the least loss of `best` and of samples, which are drawn until `needed` (of that loss) are."""
    drawn = 0
    for samples in _samples(problem):
        if drawn >= needed(least):
            break
        drawn += len(samples)
        candidate, loss = judge(_through(problem, samples))
        if loss < least:
            best, least = candidate, loss
    return best


def samples_needed(problem: Problem, outliers: float) -> float:
    """Until one sample without an outlier was drawn with _CONFIDENCE, of a share of `outliers`."""
    clean = min(max(1e-3, 1.0 - outliers), 1 - 1e-9) ** minimal_points(problem.basis.model)
    return math.log(1 - _CONFIDENCE) / math.log(1 - clean)


def _samples(problem: Problem) -> Iterator[IdArray]:
    """Batches of minimal samples, (_BATCH, n) indices, of trusted features where there are; the same at every call."""
    draw = np.random.default_rng(_SEED)
    n = minimal_points(problem.basis.model)
    pool = np.flatnonzero(problem.trust > TRUSTED)
    pool = pool if len(pool) >= 2 * n else np.arange(len(problem.pairs))
    for _ in range(_MAX_SAMPLES // _BATCH):
        samples = pool[draw.integers(0, len(pool), (_BATCH, n))]
        yield samples[[len(set(row)) == n for row in samples.tolist()]]


def _through(problem: Problem, samples: IdArray) -> FloatArray:
    """The homographies through the samples, (M, 3, 3)."""
    pairs = problem.pairs
    return minimal_homographies(problem.basis.model, pairs.current_px[samples], pairs.reference_px[samples])
