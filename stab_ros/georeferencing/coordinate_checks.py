"""Whether control points fit better if their coordinates are read in another way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.georeferencing.camera_fit import CameraFit
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.plane_fit import PlaneFit
from stab_ros.georeferencing.unit_checks import FOOT_M

_BETTER = 5.0  # ratio of the residuals
_LARGE = 0.005  # residuals, as a share of the width of the picture, from which on another reading is looked for
_EXACT = 0.002  # and those that another reading must reach


Fit: TypeAlias = CameraFit | PlaneFit
Fitter: TypeAlias = Callable[[ControlPoints], Fit]


def fit_as_read(points: ControlPoints, size: tuple[int, int], fit_to: Fitter,
                advice: Callable[[], str | None] = lambda: None) -> Fit:
    """The fit to points, unless another way to read them explains that it is bad.

    Args:
        points: as read.
        size: width and height of the picture, px.
        fit_to: the fit to points.
        advice: what helps where none is possible, and no other way to read them explains that.

    Raises:
        InputError: none is possible, or another reading fits far better.
    """
    try:
        fit = fit_to(points)
    except InputError as error:
        reading = another_reading(points, size, None, fit_to)
        if reading:
            raise InputError(f"{reading}; as they are: {error}") from error
        advised = advice()
        raise InputError(f"{error}; {advised}" if advised else str(error)) from error
    reading = another_reading(points, size, fit, fit_to)
    if reading:
        raise InputError(f"{reading}, and as they are {_as_read(fit)}")
    return fit


def _as_read(fit: Fit) -> str:
    without = f" without {', '.join(fit.wrong)}" if fit.wrong else ""
    below = ", but with the camera below all of them" if below_points(fit) else ""
    return f"within {fit.rmse_px:.2g} px{without}{below}"


def another_reading(points: ControlPoints, size: tuple[int, int], fit: Fit | None, fit_again: Fitter
                    ) -> str | None:
    """The way to read the coordinates that explains a bad fit, in one line; None: the fit is good, or nothing does.

    Args:
        points: as read.
        size: width and height of the picture, px.
        fit: to them; None: it was refused.
        fit_again: the same fit to other points.
    """
    below = fit is not None and below_points(fit)
    if fit is not None and not below and len(fit.wrong) < 2 and fit.rmse_px < _LARGE * size[0]:
        return None
    for text, other in _readings(points, size):
        again = _tried(fit_again, other)
        if again is None or again.wrong or below_points(again) or again.rmse_px > _EXACT * size[0]:
            continue
        if fit is None or _explains(again, fit, below):
            return f"{text}: read so, the points fit within {again.rmse_px:.2g} px"
    return None


def _explains(again: Fit, fit: Fit, below: bool) -> bool:
    """Whether another reading explains what is bad of a fit: that of all points, also of those that were left out."""
    if isinstance(again, PlaneFit) and isinstance(fit, CameraFit):
        return False  # a homography fits the mirror image of points in a plane as well as the points
    return below or again.rmse_px < _of_all_px(fit) / _BETTER


def _of_all_px(fit: Fit) -> float:
    """Root mean square distance of all points; infinite where one is behind the camera."""
    size_px = float(np.sqrt(np.mean(np.sum(fit.residuals_px**2, axis=1))))
    return size_px if np.isfinite(size_px) else np.inf


def _readings(points: ControlPoints, size: tuple[int, int]) -> Iterator[tuple[str, ControlPoints]]:
    names, px, map_m = points.names, points.image_px, points.map_m
    yield "east and north (or latitude and longitude) seem to be swapped", points.swapped
    yield "heights seem to be in feet and places in metres", ControlPoints(names, px, map_m * [1, 1, FOOT_M])
    yield "heights seem to be in metres and places in feet", ControlPoints(names, px, map_m * [FOOT_M, FOOT_M, 1])
    yield ("y seems to be counted from the bottom of the picture, it must be from the top",
           ControlPoints(names, np.column_stack([px[:, 0], size[1] - 1 - px[:, 1]]), map_m))
    if px.max() < min(size):
        yield "x and y in the picture seem to be swapped", ControlPoints(names, px[:, ::-1], map_m)


def _tried(fit_again: Fitter, points: ControlPoints) -> Fit | None:
    try:
        return fit_again(points)
    except InputError:  # such a reading makes no sense
        return None


def below_points(fit: Fit) -> bool:
    """Whether the camera would look up at all points."""
    if isinstance(fit, PlaneFit):
        return False
    return bool((fit.points.map_m[fit.used, 2] > fit.view.pose.position_m[2]).all())


def below_text(fit: CameraFit) -> str:
    """That the camera would look up at all points, in one line."""
    lowest_m = float(fit.points.map_m[fit.used, 2].min())
    return (f"the points put the camera at {fit.view.pose.position_m[2]:.2f} m, below all of them (the lowest at "
            f"{lowest_m:.2f} m); pixels and places must belong together, and heights must be positive upwards")
