"""Control points in the map: from the coordinates of a survey to east, north, up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import inside
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.local_frame import (
    FARTHEST_M,
    LOCAL,
    LocalFrame,
    area_doubt,
    crs_doubt,
    is_projected,
)
from stab_ros.georeferencing.survey_units import unit_in

WGS84 = "EPSG:4326"
_LIKE_A_GRID = 20_000.0  # coordinates above it are those of a projected system
_LIKE_DEGREES = 0.02  # extent below which coordinates are no metres; in degrees it is about 2 km
_AWAY = 5.0  # from 0, in extents, where degrees are and a model on a table is not


@dataclass(frozen=True, eq=False)
class PlacedPoints:
    """Control points in the map.

    Attributes:
        points: of the map.
        crs: the reference system of the survey, "EPSG:nnnn" or "local".
        frame: the map's place on the earth; None for "local".
        doubts: about the coordinates, one line each.
    """

    points: ControlPoints
    crs: str
    frame: LocalFrame | None
    doubts: tuple[str, ...] = ()


def survey_crs(crs: str | None, table_crs: str | None, geographic: bool) -> str | None:
    """The reference system of surveyed points, for `placed`.

    Args:
        crs: that is asked for; beside latitudes and longitudes a projected one is that of orthophotos. None: none is.
        table_crs: that the file of the points names; None: none.
        geographic: whether the points have longitudes and latitudes.

    Raises:
        InputError: `crs` is unknown.
    """
    of_points = crs is not None and not (geographic and is_projected(crs))
    return crs if of_points else table_crs


def placed(names: tuple[str, ...], image_px: FloatArray, places: FloatArray, crs: str | None, *,
           geographic: bool = False, unit_m: float | None = None, frame: LocalFrame | None = None,
           level_m: float | None = None) -> PlacedPoints:
    """Puts surveyed points into the map.

    Args:
        names: of each.
        image_px: (N, 2).
        places: (N, 3), easting, northing, height, or longitude, latitude, height; a height may be NaN.
        crs: "EPSG:nnnn", "local", or None: WGS 84 for latitudes and longitudes, else local.
        geographic: whether `places` are longitudes and latitudes.
        unit_m: metres of the unit in which eastings and northings were surveyed, where they are metres now; None: they
            are in the unit of the reference system.
        frame: the map; None: one whose origin lies amid the points, at height 0, so that up is the height as surveyed.
        level_m: height of points without one.

    Raises:
        InputError: the reference system is unknown, or coordinates do not fit it.
    """
    name = str(crs or (WGS84 if geographic else LOCAL))
    if geographic and name.lower() == LOCAL:
        raise InputError(f"latitudes and longitudes are not local, their reference system must be {WGS84} or another")
    if geographic and is_projected(name):
        raise InputError(f"{name} has eastings and northings, and the points latitudes and longitudes, whose reference "
                         f"system must be {WGS84} or another with degrees")
    heights = np.where(np.isfinite(places[:, 2]), places[:, 2], 0.0 if level_m is None else level_m)
    unit, said = unit_in(name, unit_m, "control points")
    full = np.column_stack([places[:, :2] / unit, heights])
    doubts = [*said, *_doubts(name, full)]
    if level_m is None and not np.isfinite(places[:, 2]).all():
        doubts.append("points without a height are taken to lie at 0 m; give the water surface elevation")
    if name.lower() == LOCAL:
        _check_near(names, full)
        _check_metres(full)
        return PlacedPoints(ControlPoints(names, image_px, full), LOCAL, None, tuple(doubts))
    frame = frame or _frame_amid(name, full)
    points = ControlPoints(names, image_px, frame.from_crs(name, full), _swapped(name, full))
    beside = area_doubt(name, frame.to_geodetic(points.map_m.mean(axis=0)[None])[0])
    doubts += [beside] if beside else []
    return PlacedPoints(points, name, frame, tuple(doubts))


def _frame_amid(crs: str, places: FloatArray) -> LocalFrame:
    return LocalFrame.at(crs, np.append(places[:, :2].mean(axis=0), 0.0))


def _swapped(crs: str, places: FloatArray) -> FloatArray | None:
    """Where in a map the points (N, 3) would lie, were their first two coordinates swapped; None: nowhere."""
    other = places[:, [1, 0, 2]]
    try:
        return _frame_amid(crs, other).from_crs(crs, other)
    except InputError:  # out of the range of the system
        return None


def _check_near(names: tuple[str, ...], map_m: FloatArray) -> None:
    """Raises InputError for a point (of N, (N, 3)) that no picture shows together with the others."""
    away_m = np.abs(map_m - np.median(map_m, axis=0)).max(axis=1)
    farthest = int(np.argmax(away_m))
    if not away_m[farthest] < FARTHEST_M:
        raise InputError(f"control point {names[farthest]!r} is {away_m[farthest] / 1e3:.4g} km away from the others, "
                         f"at most {FARTHEST_M / 1e3:g} km make sense; coordinates must be metres")


def _check_metres(places: FloatArray) -> None:
    """Raises InputError for places (N, 3) that are degrees."""
    extent = float(np.ptp(places[:, :2], axis=0).max())
    first, second = np.abs(places[:, :2]).max(axis=0)
    in_range = min(first, second) <= 90 and max(first, second) <= 180
    if 0 < extent < _LIKE_DEGREES and in_range and max(first, second) > _AWAY * extent:
        raise InputError(f"coordinates as {places[0, 0]:.9g}, {places[0, 1]:.9g}, all within {extent:.2g} of each "
                         "other, look like degrees, they must be metres; name their columns lat and lon, or give the "
                         f"reference system, as {WGS84}")


def check_inside(points: ControlPoints, size: tuple[int, int]) -> None:
    """Raises InputError for a point outside an image of `size` (width, height)."""
    outside = np.flatnonzero(~inside(points.image_px, size)).tolist()
    if outside:
        x, y = points.image_px[outside[0]]
        others = f", and {len(outside) - 1} more" if len(outside) > 1 else ""
        raise InputError(f"control point {points.names[outside[0]]!r} at ({x:g}, {y:g}){others} lies outside the "
                         f"{size[0]}x{size[1]} picture; it must be marked in a picture of this size")


def _doubts(name: str, places: FloatArray) -> list[str]:
    if name.lower() != LOCAL:
        doubt = crs_doubt(name)
        return [doubt] if doubt else []
    if np.abs(places[:, :2]).max() < _LIKE_A_GRID:
        return []
    return [f"coordinates as {places[0, 0]:.9g}, {places[0, 1]:.9g} look like those of a projected reference system "
            "whose EPSG code is not given: they are taken for local metres"]
