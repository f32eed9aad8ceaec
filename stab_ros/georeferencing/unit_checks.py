"""Whether lengths that are known twice have one unit."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.control_points import ControlPoints

FOOT_M = 0.3048
_DIFFERS = 0.05  # relative difference that is doubted
_LIKE_FEET = 0.08  # relative difference of a ratio from that of foot and metre


def is_feet(ratio: float) -> bool:
    """Whether two lengths of this ratio differ by that of a foot and a metre, or a metre and a foot."""
    return ratio > 0 and abs(abs(math.log(ratio)) - math.log(1 / FOOT_M)) < math.log(1 + _LIKE_FEET)


def length_doubt(what: str, fitted_m: float, given_m: float) -> str | None:
    """What a length that is known tells of the control points, in one line; None: they agree.

    Args:
        what: the length in words, as "the camera's height above the water".
        fitted_m: in the map of the control points.
        given_m: as known.
    """
    ratio = fitted_m / given_m
    if abs(ratio - 1) < _DIFFERS:
        return None
    said = f"{what} is {fitted_m:.4g} m by the control points and {given_m:.4g} m as given"
    if is_feet(ratio):
        which = "control points" if ratio > 1 else "given lengths"
        return f"{said}: the {which} seem to be in feet, they must be in metres (scale off by 3.28)"
    return f"{said}: one of both is wrong"


def distance_m(points: ControlPoints, first: str, second: str) -> float:
    """Distance of two control points by name.

    Raises:
        InputError: there is no such point, or they are one.
    """
    missing = [name for name in (first, second) if name not in points.names]
    if missing or first == second:
        known = ", ".join(points.names[:20])
        raise InputError(f"a distance from {first!r} to {second!r}, it must be between two of {known}")
    a, b = (points.map_m[points.names.index(name)] for name in (first, second))
    return float(np.linalg.norm(a - b))


def position_doubt(points: ControlPoints, free_m: FloatArray, sigma_m: float, given_m: FloatArray) -> str | None:
    """What the points alone tell of a position that was given; None: they agree.

    Args:
        points: control points.
        free_m: (3,), where a fit without the given position puts the camera.
        sigma_m: its standard deviation.
        given_m: (3,), as given.
    """
    away = float(np.linalg.norm(free_m - given_m))
    here = float(np.linalg.norm(free_m - points.map_m.mean(axis=0)))
    if away < max(4 * sigma_m, 0.005 * here):
        return None
    place = ", ".join(f"{value:.2f}" for value in free_m)
    said = f"the points put the camera {away:.3g} m away from the position that was given, at ({place})"
    for scale, which in ((1 / FOOT_M, "control points seem"), (FOOT_M, "position that was given seems")):
        if np.linalg.norm(free_m - given_m * scale) < max(4 * sigma_m, _DIFFERS * away):
            return f"{said}: the {which} to be in feet, all must be in metres (scale off by 3.28)"
    return said
