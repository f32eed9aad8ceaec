"""Checks of the points that a user names."""

from __future__ import annotations

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import inside
from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray
from stab_ros.estimation.models import minimal_points

_ROUNDING_PX = 1.0  # a method may move a point to the nearest place its grid of pixels has


def check_count(points_px: FloatArray, model: str, min_inliers: int) -> None:
    """Raises InputError where (n, 2) points, of which there are any, are too few to find a homography with."""
    n, least = len(points_px), minimal_points(model)
    if n and n < least:
        raise InputError(f"points: {counted(n, 'point')} cannot determine a {model} homography, there must be at least "
                         f"{least}")
    if n and n < min_inliers:
        raise InputError(f"points: {counted(n, 'point')} can never be the {min_inliers} inliers a frame must have, "
                         f"name more or set min_inliers to {n} or less")


def check_inside(points_px: FloatArray, size: tuple[int, int]) -> None:
    """Raises InputError for a point outside a reference of `size` (width, height)."""
    _refuse(points_px[~inside(points_px, size)], f"outside the reference of {size[0]}x{size[1]} px, "
            "it must lie on static ground in it")


def check_used(points_px: FloatArray, features_px: FloatArray, method: str) -> None:
    """Raises InputError for a point that the method made no feature (m, 2) of."""
    apart = np.abs(points_px[:, None] - features_px[None]).max(axis=2).min(axis=1, initial=np.inf)
    _refuse(points_px[apart > _ROUNDING_PX], "too near the border or on too little texture "
            f"for {method}, it must lie further inside or on more of it")


def _refuse(points_px: FloatArray, where: str) -> None:
    if len(points_px):
        raise InputError(f"points: ({points_px[0, 0]:g}, {points_px[0, 1]:g}) lies {where}")
