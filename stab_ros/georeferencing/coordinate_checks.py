"""Whether control points fit better if their coordinates are read in another way."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.georeferencing.camera_fit import CameraFit
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.plane_fit import PlaneFit
from stab_ros.georeferencing.unit_checks import FOOT_M

_BETTER = 5.0  # ratio of the residuals
_LARGE = 0.005  # residuals, as a share of the width of the picture, from which on another reading is looked for
_EXACT = 0.002  # and those that another reading must reach


def another_reading(points: ControlPoints, size: tuple[int, int], fit: CameraFit | PlaneFit | None,
                    fit_again: Callable[[ControlPoints], CameraFit | PlaneFit]) -> str | None:
    """The way to read the coordinates that explains a bad fit, in one line; None: the fit is good, or nothing does.

    Args:
        points: as read.
        size: width and height of the picture, px.
        fit: to them; None: it was refused.
        fit_again: the same fit to other points.

    """
    below = fit is not None and _below(fit)
    if fit is not None and not below and len(fit.wrong) < 2 and fit.rmse_px < _LARGE * size[0]:
        return None
    for text, other in _readings(points, size):
        again = _tried(fit_again, other)
        if again is None or again.wrong or _below(again) or again.rmse_px > _EXACT * size[0]:
            continue
        if below or fit is None or again.rmse_px < fit.rmse_px / _BETTER or len(fit.wrong) >= 2:
            return f"{text}: read so, the points fit within {again.rmse_px:.2g} px"
    return None


def _readings(points: ControlPoints, size: tuple[int, int]) -> Iterator[tuple[str, ControlPoints]]:
    names, px, map_m = points.names, points.image_px, points.map_m
    yield ("east and north (or latitude and longitude) seem to be swapped",
           ControlPoints(names, px, map_m[:, [1, 0, 2]]))
    yield "heights seem to be in feet and places in metres", ControlPoints(names, px, map_m * [1, 1, FOOT_M])
    yield "heights seem to be in metres and places in feet", ControlPoints(names, px, map_m * [FOOT_M, FOOT_M, 1])
    yield ("y seems to be counted from the bottom of the picture, it must be from the top",
           ControlPoints(names, np.column_stack([px[:, 0], size[1] - 1 - px[:, 1]]), map_m))
    if px.max() < min(size):
        yield "x and y in the picture seem to be swapped", ControlPoints(names, px[:, ::-1], map_m)


def _tried(fit_again: Callable[[ControlPoints], CameraFit | PlaneFit], points: ControlPoints
           ) -> CameraFit | PlaneFit | None:
    try:
        return fit_again(points)
    except InputError:  # such a reading makes no sense
        return None


def _below(fit: CameraFit | PlaneFit) -> bool:
    """Whether the camera would look up at all points."""
    if isinstance(fit, PlaneFit):
        return False
    return bool((fit.points.map_m[fit.used, 2] > fit.view.pose.position_m[2]).all())
