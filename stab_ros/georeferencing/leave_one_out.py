"""How well a fit predicts each control point from the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.adjustment import Movable, Solution, solved
from stab_ros.georeferencing.camera_fit import CameraFit
from stab_ros.georeferencing.camera_problem import CameraProblem
from stab_ros.georeferencing.levels import on_own_level
from stab_ros.georeferencing.plane_fit import PlaneFit, PlaneProblem


def leave_one_out(fit: CameraFit | PlaneFit) -> tuple[FloatArray, FloatArray]:
    """Residuals of each point in a fit to all other used points.

    Returns:
        (N, 2), px, and (N, 2), east and north, m; NaN where the others do not tell the fit.
    """
    if isinstance(fit, PlaneFit):
        return _left_out(fit.solution, _on_plane)
    return _left_out(fit.solution, _on_level)


def _left_out(solution: Solution[Movable], on_ground: Callable[[Movable], FloatArray]) -> tuple[FloatArray, FloatArray]:
    px, ground = (np.full((len(solution.used), 2), np.nan) for _ in range(2))
    for i in range(len(solution.used)):
        used = solution.used & (np.arange(len(solution.used)) != i)
        part = solved(solution.problem, used, solution.noise) if solution.used[i] else solution
        if np.isfinite(part.cofactors).all():
            px[i], ground[i] = part.residuals_px[i], on_ground(part.problem)[i]
    return px, ground


def _on_level(problem: CameraProblem) -> FloatArray:
    points = problem.points
    return on_own_level(problem.view, points.image_px, points.map_m) - points.map_m[:, :2]


def _on_plane(problem: PlaneProblem) -> FloatArray:
    points = problem.points
    return apply(problem.map_H_image(np.zeros(8)), points.image_px) - points.map_m[:, :2]
