"""A fit from several starts, to which wrong points do no harm: least trimmed squares, then tests of single points."""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.georeferencing.adjustment import Movable, Problem, Solution, solved
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.georeferencing.wrong_points import Cleaned, without_wrong

_CONCENTRATIONS = 4  # steps of least trimmed squares


def fitting(count: int, parameters: int) -> int:
    """Number of points that a start must fit: three quarters, and enough for the parameters and one point more."""
    return min(count, max(count - max(1, count // 4), (parameters + 1) // 2 + 1))


def trimmed(errors2: FloatArray, kept: int) -> float:
    """Sum of the `kept` least of squares (N,)."""
    return float(np.partition(errors2, kept - 1)[:kept].sum())


def fitted_to_best(problems: Iterable[Movable], noise: PointNoise) -> list[Solution[Movable]]:
    """Fits of each start to the points that fit it best, the best first (Rousseeuw and Van Driessen 2006)."""
    return sorted((_concentrated(problem, noise) for problem in problems), key=_score)


def cleaned(start: Solution[Movable], noise: PointNoise) -> Cleaned:
    """The fit to all points that do not contradict the others, from a fit to the best ones."""
    def solve(used: BoolArray) -> Solution[Problem]:
        return cast("Solution[Problem]", solved(start.problem, used, noise))

    count = len(start.used)
    return without_wrong(solve, cast("Solution[Problem]", start), count - fitting(count, start.problem.parameters))


def _concentrated(problem: Movable, noise: PointNoise) -> Solution[Movable]:
    solution = Solution(problem, np.ones(len(problem.observed_px), bool), noise)
    for _ in range(_CONCENTRATIONS):
        used = _best(solution)
        same = bool((used == solution.used).all())
        solution = solved(solution.problem, used, noise)
        if same:
            break
    return solution


def _best(solution: Solution[Movable]) -> BoolArray:
    used = np.zeros(len(solution.used), bool)
    kept = fitting(len(used), solution.problem.parameters)
    used[np.argsort(_squares(solution), kind="stable")[:kept]] = True
    return used


def _score(solution: Solution[Movable]) -> float:
    squares = _squares(solution)
    return trimmed(squares, fitting(len(squares), solution.problem.parameters))


def _squares(solution: Solution[Movable]) -> FloatArray:
    return np.asarray(np.nan_to_num(np.sum(solution.whitened**2, axis=1), nan=np.inf))
