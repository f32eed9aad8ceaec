"""What control points do not tell about a camera: measured by the uncertainty of the fit, and by rival fits.

Points on a line, in one plane that the camera faces, few points or points in a corner are not looked for: each makes
some parameter uncertain, and that is what is refused.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from stab_ros.core.geometry import grid
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.adjustment import Solution, solved
from stab_ros.georeferencing.camera_problem import CameraProblem
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.levels import on_own_level
from stab_ros.georeferencing.point_noise import LEAST_NOISE_PX
from stab_ros.imaging.view import View

_REFUSED, _DOUBTED = 0.1, 0.03  # standard deviations: share of a length, or rad
_PROFILE = 0.25  # change of the focal length that the residuals must notice
_NOTICED = 9.0  # increase of the squared residuals, in variances: 3 sigma
_FAR_PX = 3.0  # uncertainty at the border of the image
_FARTHER = 2.0  # distance of places that are judged, as a multiple of that of the farthest point
_FAR_FACTOR = 6.0  # and relative to that at the points
_UNCHECKED = 0.02  # share of an error that shows in the point's own residual
_CONTRADICTED = 1e-3  # chance below which residuals contradict the noise that was given
_MANY, _NOTABLE_PX = 8, 2.0  # redundancy that tells wrong points, and noise that is doubted below it
_ON_LINE = 0.03  # spread across, as a share of that along
_LARGE = 0.005  # share of the image's width that residuals reach where something is wrong


def refusals(solution: Solution[CameraProblem]) -> list[str]:
    """What cannot be told, one line each; empty where all can."""
    found = _uncertain(solution, _REFUSED)
    if not found and solution.problem.unknowns.focals and _focal_is_free(solution):
        found = [_FOCAL_TEXT.format(f"residuals hardly notice a change of it by {100 * _PROFILE:.0f} %")]
    return found


def doubts(solution: Solution[CameraProblem], names: Sequence[str]) -> list[str]:
    """What is doubtful of a fit that is not refused, one line each."""
    return [*_uncertain(solution, _DOUBTED), *_unchecked(solution, names), *_far(solution), *_residuals(solution)]


def judged_variance(solution: Solution[CameraProblem]) -> float:
    """Variance of whitened residuals, not below what control points ever have."""
    if solution.noise.image_px is not None:
        return max(solution.covering_variance, 1.0)
    return max(solution.covering_variance, LEAST_NOISE_PX**2)


def rivals(best: Solution[CameraProblem], others: Sequence[Solution[CameraProblem]]) -> list[View]:
    """Views other than the best that the points fit as well, within 3 sigma."""
    found: list[View] = []
    for other in others:
        again = solved(other.problem, best.used, best.noise)
        view = again.problem.view
        if (again.rss - best.rss < _NOTICED * judged_variance(best) and _in_front(view, best)
                and all(_apart(view, one, best) for one in [best.problem.view, *found])):
            found.append(view)
    return found


_FOCAL_TEXT = ("the points do not tell the focal length from the distance ({}), as where they lie in one plane that "
               "faces the camera; calibrate the camera, give its position, or add points of other heights")
_SPREAD = "they must spread over more of the picture and not lie on a line"


def why_untold(points: ControlPoints) -> str:
    """A remark on points that lie on a line, on the ground or in the picture; "" for others."""
    for places, where in ((points.map_m, ""), (points.image_px, "in the picture ")):
        spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
        if spread[1] < _ON_LINE * spread[0]:
            return f" ({where}they lie nearly on a line)"
    return ""


def _uncertain(solution: Solution[CameraProblem], limit: float) -> list[str]:
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(np.diag(solution.cofactors) * judged_variance(solution))
    unknowns, found = solution.problem.unknowns, []
    if unknowns.focals and sigma[unknowns.focal].max() > limit:
        found.append(_FOCAL_TEXT.format(f"{_percent(sigma[unknowns.focal].max())} uncertain"))
    elif unknowns.position and sigma[:3].max() > limit * _distance_m(solution):
        found.append("the points do not tell the position of the camera "
                     f"({sigma[:3].max():.3g} m uncertain): {_SPREAD}")
    elif sigma[unknowns.rotation].max() > limit:
        found.append("the points do not tell the attitude of the camera "
                     f"({np.degrees(sigma[unknowns.rotation].max()):.3g} degrees uncertain): {_SPREAD}")
    if unknowns.k1 and sigma[-1] * _reach2(solution) > limit:
        found.append(f"the points do not tell k1 ({sigma[-1]:.3g} uncertain): leave it out, or add points near the "
                     "border of the picture")
    return found


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 1 else "entirely"


def _distance_m(solution: Solution[CameraProblem]) -> float:
    problem = solution.problem
    return float(np.linalg.norm(problem.view.pose.position_m - problem.points.map_m.mean(axis=0)))


def _reach2(solution: Solution[CameraProblem]) -> float:
    """Squared distance of the border of the picture from its middle, in focal lengths."""
    camera = solution.problem.view.camera
    return float((camera.size[0] / 2 / camera.K[0, 0]) ** 2)


def _focal_is_free(solution: Solution[CameraProblem]) -> bool:
    """Whether some other focal length fits as well, with all else adjusted to it."""
    problem = solution.problem
    allowed = solution.rss + _NOTICED * judged_variance(solution)
    return any(solved(problem.zoomed(factor), solution.used, solution.noise).rss < allowed
               for factor in (1 - _PROFILE, 1 + _PROFILE))


def _in_front(view: View, solution: Solution[CameraProblem]) -> bool:
    return bool((view.pose.to_camera(solution.problem.points.map_m[solution.used])[:, 2] > 0).all())


def _apart(a: View, b: View, solution: Solution[CameraProblem]) -> bool:
    """Whether two views differ by more than their uncertainty can."""
    shift = np.linalg.norm(a.pose.position_m - b.pose.position_m)
    turn = np.linalg.norm(a.pose.cam_R_map - b.pose.cam_R_map)
    return bool(turn > 0.02 or shift > 0.02 * _distance_m(solution))


def _unchecked(solution: Solution[CameraProblem], names: Sequence[str]) -> list[str]:
    shares = np.linalg.eigvalsh(solution.redundancies)[:, 0]
    alone = [names[i] for i in np.flatnonzero(solution.used & (shares < _UNCHECKED)).tolist()]
    if not alone or solution.redundancy <= 0:
        return [] if solution.redundancy > 0 else ["no point is more than needed: nothing checks the fit"]
    return [f"an error of {', '.join(alone)} would not show: no other point checks what {_it(alone)} alone"]


def _it(names: Sequence[str]) -> str:
    return "it tells" if len(names) == 1 else "each tells"


def _far(solution: Solution[CameraProblem]) -> list[str]:
    """Compares the uncertainty of places near the border of the picture with that at the points."""
    problem, covariance = solution.problem, solution.cofactors * judged_variance(solution)
    far = _places(problem)
    if not len(far.points):
        return []
    at_border, at_points = (float(_sigma_px(one, covariance).max()) for one in (far, problem))
    if at_border < max(_FAR_PX, _FAR_FACTOR * at_points):
        return []
    return [f"the points lie in one part of the picture: elsewhere places are up to {at_border:.2g} px uncertain, at "
            f"the points {at_points:.2g} px"]


def _sigma_px(problem: CameraProblem, covariance: FloatArray) -> FloatArray:
    J = problem.jacobian(np.zeros(problem.parameters))
    return np.asarray(np.sqrt(np.einsum("nij,jk,nik->n", J, covariance, J)))


def _places(problem: CameraProblem) -> CameraProblem:
    """Places all over the picture, on the level of the points and not much farther than they are."""
    camera, map_m = problem.view.camera, problem.points.map_m
    px = grid(camera.size)
    level = np.full((len(px), 3), map_m[:, 2].mean())
    places = np.column_stack([on_own_level(problem.view, px, level), level[:, 2]])
    farthest = np.linalg.norm(map_m - problem.view.pose.position_m, axis=1).max()
    away = np.linalg.norm(places - problem.view.pose.position_m, axis=1)
    near = np.asarray(np.nan_to_num(away, nan=np.inf) < _FARTHER * farthest)
    names = tuple(str(i) for i in np.flatnonzero(near))
    return dataclasses.replace(problem, points=ControlPoints(names, px[near], places[near]))


def _residuals(solution: Solution[CameraProblem]) -> list[str]:
    rms_px = float(np.sqrt(np.mean(np.sum(solution.residuals_px[solution.used] ** 2, axis=1))))
    noise, redundancy = solution.noise, solution.redundancy
    if noise.image_px is not None and redundancy > 0 and chdtrc(redundancy, solution.rss) < _CONTRADICTED:
        return [f"residuals of {rms_px:.2g} px contradict the noise that was given: the uncertainties are too small by "
                f"a factor of {np.sqrt(solution.rss / redundancy):.2g}"]
    if noise.image_px is None and 0 < redundancy < _MANY and solution.rss > _NOTABLE_PX**2 * redundancy:
        return [f"residuals of {rms_px:.2g} px, and too few points to tell whether one of them is wrong"]
    if rms_px > _LARGE * solution.problem.view.camera.size[0]:
        return [f"residuals of {rms_px:.2g} px are large: several points may be wrong, or the camera is another one"]
    return []
