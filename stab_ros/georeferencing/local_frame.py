"""The map: local east, north and up in true metres, and the way to it from geodetic and projected coordinates.

The axes are those of the tangent plane at the origin (topocentric, EPSG method 9837), so a UTM zone's scale and
convergence are taken out, and so is the curvature: 180 m from the origin, the ellipsoid is 2.5 mm below the plane.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pyproj import CRS, Transformer
from pyproj.enums import TransformDirection
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray

_BESIDE_DEG = 3.0  # beyond the area of a system, where it may still be used
LOCAL = "local"  # the name of no reference system: coordinates are taken as they are
FARTHEST_M = 100_000.0  # from the origin of the map; what is farther away is taken for an error
_STEP_M = 50.0  # of the derivative of a projection
_FORWARD, _INVERSE = TransformDirection.FORWARD, TransformDirection.INVERSE


@dataclass(frozen=True)
class LocalFrame:
    """The map frame with its origin.

    Attributes:
        latitude_deg: of the origin, WGS 84, positive north.
        longitude_deg: of the origin, positive east.
        height_m: of the origin above the ellipsoid.

    Raises:
        InputError: not finite or out of range.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float

    def __post_init__(self) -> None:
        _check_geodetic(np.array([[self.latitude_deg, self.longitude_deg, self.height_m]]))

    @staticmethod
    def at(crs: int | str, point: FloatArray) -> LocalFrame:
        """The map whose origin is a point (3,) of a reference system, as `from_crs` takes it."""
        lon, lat, height = _transformed(_transformer(_name(crs)), np.asarray(point, float)[None])[0]
        return LocalFrame(float(lat), float(lon), float(height))

    @property
    def utm(self) -> str:
        """The zone of UTM (WGS 84) around the origin, "EPSG:nnnnn"; those of Norway and Svalbard are not widened."""
        zone = min(int((self.longitude_deg + 180) // 6) + 1, 60)
        return f"EPSG:{(32600 if self.latitude_deg >= 0 else 32700) + zone}"

    def from_geodetic(self, lat_lon_height: FloatArray) -> FloatArray:
        """Points of WGS 84 in the map.

        Args:
            lat_lon_height: (N, 3) latitude and longitude, degrees, and height above the ellipsoid, m.

        Returns:
            (N, 3) east, north, up, m.

        Raises:
            InputError: out of range, farther from the origin than `FARTHEST_M`, or swapped.
        """
        given = np.asarray(lat_lon_height, float)
        _check_geodetic(given)
        return self._near(self._enu, given, "latitude and longitude")

    def to_geodetic(self, map_m: FloatArray) -> FloatArray:
        """Latitude and longitude, degrees, and height above the ellipsoid, m, (N, 3), of points (N, 3) of the map."""
        lon, lat, height = _transformed(self._topocentric, np.asarray(map_m, float), _INVERSE).T
        return np.column_stack([lat, lon, height])

    def from_map(self, other: LocalFrame) -> tuple[FloatArray, FloatArray]:
        """The way from another map to this one, which turns it, too: meridians converge, and the Earth is round.

        Returns:
            R (3, 3) and t (3,), m: a point p of the other map lies at R p + t in this one.

        Raises:
            InputError: its origin is farther from this one than `FARTHEST_M`, or swapped.
        """
        origin = np.array([[other.latitude_deg, other.longitude_deg, other.height_m]])
        return self._earth_R_map.T @ other._earth_R_map, self.from_geodetic(origin)[0]

    def from_crs(self, crs: int | str, points: FloatArray) -> FloatArray:
        """Points of a reference system in the map.

        Args:
            crs: EPSG code of a projected or geographic system, as 32632 or "EPSG:32632"; "local": as they are.
            points: (N, 3) easting, northing (or longitude, latitude) in the units of the system, and height above the
                ellipsoid, m.

        Returns:
            (N, 3) east, north, up, m: true metres, not those of the grid.

        Raises:
            InputError: the system is unknown, or has heights of its own; a point is out of its range, farther from the
                origin than `FARTHEST_M`, or swapped.
        """
        name = _name(crs)
        if name == LOCAL:
            return np.asarray(points, float)
        to_geodetic = _transformer(name)

        def to_map(given: FloatArray) -> FloatArray:
            return self._enu(_transformed(to_geodetic, given)[:, [1, 0, 2]])

        return self._near(to_map, np.asarray(points, float), f"{name}: easting and northing")

    def to_crs(self, crs: int | str, map_m: FloatArray) -> FloatArray:
        """Points (N, 3) of the map in a reference system, (N, 3), as `from_crs` takes them."""
        name = _name(crs)
        if name == LOCAL:
            return np.asarray(map_m, float)
        return _transformed(_transformer(name), self.to_geodetic(map_m)[:, [1, 0, 2]], _INVERSE)

    def affine_to_crs(self, crs: int | str, at_m: FloatArray) -> FloatArray:
        """The affine map that a GeoTIFF needs: a projection, linearised.

        Args:
            crs: as for `from_crs`.
            at_m: (3,) of the map, about the centre of the image.

        Returns:
            (2, 3): easting and northing of east, north, 1 in the map at that height. `affine_error` tells how well.
        """
        at = np.asarray(at_m, float)
        steps = _STEP_M * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 0]])
        east, west, north, south, centre = self.to_crs(crs, at + steps)[:, :2]
        slope = np.column_stack([east - west, north - south]) / (2 * _STEP_M)
        return np.column_stack([slope, centre - slope @ at[:2]])

    def affine_error(self, crs: int | str, affine: FloatArray, outline_m: FloatArray) -> float:
        """Greatest distance between an affine map and the projection, in the units of the system.

        Args:
            crs: as for `from_crs`.
            affine: (2, 3), of `affine_to_crs`.
            outline_m: (n, 3), corners of the image in the map.
        """
        outline = np.asarray(outline_m, float)
        exact = self.to_crs(crs, outline)[:, :2]
        return float(np.linalg.norm(outline[:, :2] @ affine[:, :2].T + affine[:, 2] - exact, axis=1).max())

    @property
    def _earth_R_map(self) -> FloatArray:
        """(3, 3), from the axes of the map to those of the Earth-centred system (EPSG method 9837)."""
        lat, lon = np.radians([self.latitude_deg, self.longitude_deg])
        east = [-np.sin(lon), np.cos(lon), 0]
        north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
        return np.column_stack([east, north, np.cross(east, north)])

    @functools.cached_property
    def _topocentric(self) -> Transformer:
        origin = f"+lat_0={self.latitude_deg!r} +lon_0={self.longitude_deg!r} +h_0={self.height_m!r}"
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 {origin}")

    def _enu(self, lat_lon_height: FloatArray) -> FloatArray:
        return _transformed(self._topocentric, lat_lon_height[:, [1, 0, 2]])

    def _near(self, to_map: Callable[[FloatArray], FloatArray], given: FloatArray, what: str) -> FloatArray:
        """`given` in the map; what is far away is refused, and said to be swapped if swapped it would be near."""
        placed = to_map(given)
        away = np.linalg.norm(placed[:, :2], axis=1)
        far = np.flatnonzero(~(away < FARTHEST_M))
        if not len(far):
            return placed
        place = ", ".join(f"{value:.9g}" for value in given[far[0], :2])
        if self._fits_swapped(to_map, given[far]):
            raise InputError(f"{what} are swapped: {place} should be the other way round")
        raise InputError(f"{what} {place} are {away[far[0]] / 1000:.0f} km from the origin of the map at "
                         f"{self.latitude_deg:g}, {self.longitude_deg:g}, at most {FARTHEST_M / 1000:g} km make sense")

    @staticmethod
    def _fits_swapped(to_map: Callable[[FloatArray], FloatArray], given: FloatArray) -> bool:
        try:
            return bool((np.linalg.norm(to_map(given[:, [1, 0, 2]])[:, :2], axis=1) < FARTHEST_M).all())
        except InputError:  # out of the range of the projection
            return False


def crs_doubt(crs: int | str) -> str | None:
    """What makes coordinates of a reference system inexact against WGS 84 here, in one line.

    Args:
        crs: as for `LocalFrame.from_crs`.

    Returns:
        None: nothing that is known of.
    """
    name = _name(crs)
    if name == LOCAL:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is returned here, and where to download it
        group = TransformerGroup(_crs(name), CRS.from_epsg(4979), always_xy=True)
    if group.best_available or not group.transformers:
        return None
    accuracy = group.transformers[0].accuracy
    within = f"within {accuracy:g} m" if accuracy >= 0 else "within some metres"
    return f"{name} needs a grid that is not installed to fit WGS 84 exactly, it does so {within}"


def area_doubt(crs: int | str, lat_lon_height: FloatArray) -> str | None:
    """That a place lies far from where a reference system is used, in one line, as one in metres for a system in feet.

    Args:
        crs: as for `LocalFrame.from_crs`.
        lat_lon_height: (3,), degrees and m, of the place.
    """
    system, (lat, lon) = _crs(_name(crs)), lat_lon_height[:2]
    area = system.area_of_use
    if area is None:
        return None
    east_of_west, wide = (lon - area.west + _BESIDE_DEG) % 360, (area.east - area.west) % 360 or 360
    if area.south - _BESIDE_DEG <= lat <= area.north + _BESIDE_DEG and east_of_west <= wide + 2 * _BESIDE_DEG:
        return None
    return (f"the coordinates lie at {lat:.2f}, {lon:.2f} (latitude, longitude) by {_name(crs)} ({system.name}), which "
            f"is used elsewhere: they must be its easting and northing, in the unit {system.axis_info[0].unit_name}")


def metres_per_unit(crs: int | str) -> float:
    """Metres of the unit of eastings and northings; 1 for "local".

    Raises:
        InputError: the system is unknown, or has longitudes and latitudes.
    """
    name = _name(crs)
    if name == LOCAL:
        return 1.0
    if _crs(name).is_geographic:
        raise InputError(f"{name} has longitudes and latitudes in degrees, coordinates must not be lengths")
    return float(_crs(name).axis_info[0].unit_conversion_factor)


def is_projected(crs: int | str) -> bool:
    """Whether a reference system has eastings and northings, as an orthophoto needs them; "local" is none.

    Raises:
        InputError: it is unknown.
    """
    name = _name(crs)
    return name != LOCAL and bool(_crs(name).is_projected)


def projected_code(crs: int | str) -> int:
    """The EPSG code of a projected reference system.

    Raises:
        InputError: it is none.
    """
    name = _name(crs)
    if not is_projected(name):
        raise InputError(f"{name} is no projected reference system, an orthophoto needs one, as EPSG:32632")
    return int(name.removeprefix("EPSG:"))


def _name(crs: int | str) -> str:
    text = str(crs).strip()
    if text.lower() == LOCAL:
        return LOCAL
    code = text.upper().removeprefix("EPSG:")
    if not code.isdecimal():
        raise InputError(f"a reference system {text!r}, it must be an EPSG code, as EPSG:32632, or {LOCAL!r}")
    return f"EPSG:{int(code)}"


@functools.cache
def _crs(name: str) -> CRS:
    try:
        system = CRS.from_user_input(name)
    except CRSError as error:
        raise InputError(f"{name} is not a reference system that PROJ knows, it must be an EPSG code, as EPSG:32632 "
                         f"for UTM zone 32 north, or {LOCAL!r}") from error
    if system.is_compound or system.is_vertical or not (system.is_projected or system.is_geographic):
        raise InputError(f"{name} ({system.name}) is not a projected or geographic system, it must be one; heights are "
                         "given apart, with their datum")
    return system


@functools.cache
def _transformer(name: str) -> Transformer:
    """From the system (easting, northing, height) to longitude, latitude and height above the ellipsoid of WGS 84."""
    if name == LOCAL:
        raise InputError("local coordinates have no place on the earth, they need an EPSG code for that")
    return Transformer.from_crs(_crs(name), CRS.from_epsg(4979), always_xy=True)


def _transformed(transformer: Transformer, points: FloatArray, direction: TransformDirection = _FORWARD) -> FloatArray:
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError("coordinates must be rows of 3 finite numbers")
    x, y, height = np.ascontiguousarray(points.T, float)
    try:
        moved = np.column_stack(transformer.transform(x, y, height, direction=direction, errcheck=True))
    except ProjError as error:
        place = ", ".join(f"{value:.9g}" for value in points[0])
        raise InputError(f"coordinates as {place} are out of the range of their reference system") from error
    if not np.isfinite(moved).all():
        place = ", ".join(f"{value:.9g}" for value in points[~np.isfinite(moved).all(axis=1)][0])
        raise InputError(f"coordinates {place} are out of the range of their reference system")
    return np.asarray(moved)


def _check_geodetic(lat_lon_height: FloatArray) -> None:
    if lat_lon_height.ndim != 2 or lat_lon_height.shape[1] != 3 or not np.isfinite(lat_lon_height).all():
        raise InputError("geodetic coordinates must be rows of finite latitude, longitude and height")
    lat, lon = lat_lon_height[:, 0], lat_lon_height[:, 1]
    wrong = np.flatnonzero((np.abs(lat) > 90) | (np.abs(lon) > 180))
    if not len(wrong):
        return
    place = f"latitude {lat[wrong[0]]:.9g} and longitude {lon[wrong[0]]:.9g}"
    swapped = (np.abs(lon) <= 90).all() and (np.abs(lat) <= 180).all()
    advice = "they look swapped" if swapped else "they must be within 90 and 180 degrees"
    raise InputError(f"{place} are out of range, {advice}")
