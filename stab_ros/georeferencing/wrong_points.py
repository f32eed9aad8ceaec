"""Which control points contradict the others.

A set of points is taken for wrong if the fit without them is better than chance would have it: the F test on the
residuals of both fits, or the chi-square test where the noise is known (Baarda's data snooping; Foerstner and Wrobel
2016, section 4.6). Sets are drawn in the order of the residuals of a fit to the best points, so that one wrong point
does not hide another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.special import chdtrc, fdtrc

from stab_ros.core.types import BoolArray
from stab_ros.georeferencing.adjustment import Problem, Solution

SIGNIFICANCE = 0.005  # chance that right points are called wrong
_CREDIBLE = 0.01  # chance below which residuals do not fit the noise that was given
_SURE = 0.05  # chance below which another point is not the wrong one

Solve: TypeAlias = Callable[[BoolArray], Solution[Problem]]
_ROUNDING_PX = 0.01  # noise of exact points


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A fit without the points that contradict it.

    Attributes:
        solution: of the other points.
        wrong: indices of the points that were left out, the worst first.
        doubtful: indices of points of which each might be the wrong one in place of the last of `wrong`.
    """

    solution: Solution[Problem]
    wrong: tuple[int, ...] = ()
    doubtful: tuple[int, ...] = ()


def without_wrong(solve: Solve, start: Solution[Problem], most: int) -> Cleaned:
    """Leaves out wrong points.

    Args:
        solve: fits a choice of points, (N,) bool.
        start: a fit to the best points, whose residuals tell suspects.
        most: number of points that may be wrong.
    """
    size = np.sum(start.whitened**2, axis=1)
    suspects = np.argsort(-size, kind="stable").tolist()
    found = Cleaned(solve(np.ones(len(size), bool)))
    while len(found.wrong) < most:
        better = _without_more(solve, found, suspects, most - len(found.wrong))
        if better is None:
            break
        found = better
    return found


def wrong_text(names: Sequence[str], cleaned: Cleaned) -> list[str]:
    """Says which points are wrong, one line each."""
    last = cleaned.wrong[-1:]
    lines = [f"point {names[i]} contradicts the others and is left out" for i in cleaned.wrong if (i,) != last]
    if last:
        others = "".join(f" (or {names[i]} is wrong in its place)" for i in cleaned.doubtful)
        lines.append(f"point {names[last[0]]} contradicts the others and is left out{others}")
    return lines


def chance(whole: Solution[Problem], part: Solution[Problem]) -> float:
    """Probability of residuals that shrink as much where no point is wrong, for points that were not chosen.

    Args:
        whole: a fit.
        part: the same with fewer points.
    """
    removed = len(whole.design) - len(part.design)
    drop = max(whole.rss - part.rss, 0.0)
    if _credible(part):
        return float(chdtrc(removed, drop))
    if part.redundancy <= 0:
        return 1.0
    least = (_ROUNDING_PX / (part.noise.image_px or 1.0))**2
    return float(fdtrc(removed, part.redundancy, drop / removed / (part.rss / part.redundancy + least)))


def _credible(solution: Solution[Problem]) -> bool:
    """Whether the noise is known and the residuals agree."""
    known = solution.noise.image_px is not None
    return known and (solution.redundancy <= 0 or bool(chdtrc(solution.redundancy, solution.rss) > _CREDIBLE))


def _without_more(solve: Solve, found: Cleaned, suspects: Sequence[int], most: int) -> Cleaned | None:
    whole = found.solution
    one = _best_single(solve, whole)
    if one is not None:
        return Cleaned(one[1], (*found.wrong, one[0]), _doubtful(solve, whole, one[0]))
    left = [i for i in suspects if whole.used[i]]
    for k in range(2, min(most, len(left)) + 1):
        part = solve(_less(whole.used, *left[:k]))
        if chance(whole, part) * math.comb(len(left), k) < SIGNIFICANCE:
            return Cleaned(part, (*found.wrong, *left[:k]))
    return None


def _best_single(solve: Solve, whole: Solution[Problem]) -> tuple[int, Solution[Problem]] | None:
    """The point without which the fit is best, if it is wrong; only points are tried of which it looks possible."""
    parts = {i: solve(_less(whole.used, i)) for i in np.flatnonzero(whole.used).tolist() if _looks_wrong(whole, i)}
    if not parts:
        return None
    worst = min(parts, key=lambda i: parts[i].rss)
    sure = chance(whole, parts[worst]) * int(whole.used.sum()) < SIGNIFICANCE
    return (worst, parts[worst]) if sure else None


def _looks_wrong(whole: Solution[Problem], i: int) -> bool:
    """By the drop of the squares that a linear model predicts, which is nearly that of a new fit."""
    seen = whole.redundancies[i]
    drop = float(whole.whitened[i] @ np.linalg.pinv(seen, rcond=1e-6) @ whole.whitened[i])
    left = max(whole.rss - drop, 0.0)
    if whole.noise.image_px is not None:
        return bool(chdtrc(2, drop) < _SURE)
    least = (_ROUNDING_PX / 1.0)**2
    redundancy = whole.redundancy - 2
    return redundancy > 0 and bool(fdtrc(2, redundancy, drop / 2 / (left / redundancy + least)) < _SURE)


def _doubtful(solve: Solve, whole: Solution[Problem], worst: int) -> tuple[int, ...]:
    """Points without which `worst` would fit as well."""
    found = []
    for i in (i for i in np.flatnonzero(whole.used).tolist() if i != worst and _looks_wrong(whole, i)):
        part = solve(_less(whole.used, i))
        n = int(whole.used.sum())
        both = solve(_less(part.used, worst))
        if chance(whole, part) * n < SIGNIFICANCE and chance(part, both) * n > SIGNIFICANCE:
            found.append(i)
    return tuple(found)


def _less(used: BoolArray, *points: int) -> BoolArray:
    left = used.copy()
    left[list(points)] = False
    return left
