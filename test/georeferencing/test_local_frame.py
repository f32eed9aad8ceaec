"""The map against pyproj's geodesics and published constants, its ways back, and what is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from pyproj import Geod

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.local_frame import LocalFrame, crs_doubt

COQUET = LocalFrame(55.335, -1.892, 110.0)
PLACES: FloatArray = np.array([[0.0, 0, 0], [90, -35, 46], [-1800, 2500, -3]])


def test_east_and_north_are_true_metres() -> None:
    """Against geodesics of GeographicLib: azimuth and distance on the ellipsoid through the origin."""
    frame = LocalFrame(55.335, -1.892, 0.0)
    for azimuth in np.radians([0, 37, 90, 200, 311]):
        lon, lat, _ = Geod(ellps="WGS84").fwd(-1.892, 55.335, math.degrees(azimuth), 100.0)
        east, north, up = frame.from_geodetic(np.array([[lat, lon, 0.0]]))[0]
        assert (east, north) == pytest.approx((100 * math.sin(azimuth), 100 * math.cos(azimuth)), abs=1e-6)
        assert up == pytest.approx(-(100**2) / 2 / 6.38e6, rel=0.01)  # the sphere falls off


def test_points_return() -> None:
    assert np.allclose(COQUET.from_geodetic(COQUET.to_geodetic(PLACES)), PLACES, atol=1e-8)
    for crs in (32630, "EPSG:32630", "epsg:4326"):
        assert np.allclose(COQUET.from_crs(crs, COQUET.to_crs(crs, PLACES)), PLACES, atol=1e-6)
    british = COQUET.from_crs(27700, COQUET.to_crs(27700, PLACES))  # PROJ's shift of a datum leaves heights out
    assert np.allclose(british, PLACES, atol=2e-3)
    assert COQUET.from_crs("local", PLACES) is PLACES


def test_scale_and_convergence_of_utm_are_taken_out() -> None:
    """At the central meridian UTM shortens by 0.9996; beside it, its north is turned by the convergence."""
    on_meridian = LocalFrame(55.0, -3.0, 0.0)
    grid = on_meridian.to_crs(32630, np.array([[0.0, 0, 0], [1000, 0, 0]]))
    assert grid[1, 0] - grid[0, 0] == pytest.approx(999.6, abs=1e-3)
    north = np.diff(COQUET.to_crs(32630, np.array([[0.0, 0, 0], [0, 100, 0]]))[:, :2], axis=0)[0]
    convergence = math.radians(-1.892 + 3) * math.sin(math.radians(55.335))
    assert math.atan2(-north[0], north[1]) == pytest.approx(convergence, abs=1e-5)


def test_heights_above_the_ellipsoid_shift_along() -> None:
    raised = COQUET.to_geodetic(np.array([[0.0, 0, 46]]))[0]
    assert raised == pytest.approx([55.335, -1.892, 156.0], abs=1e-9)


def test_affine_map_of_a_geotiff_holds_over_a_reach() -> None:
    outline = np.array([[-150.0, -150, 0], [150, -150, 0], [150, 150, 0], [-150, 150, 0]])
    affine = COQUET.affine_to_crs(32630, np.zeros(3))
    assert COQUET.affine_error(32630, affine, outline) < 1e-3
    assert COQUET.affine_error(32630, affine, outline + np.array([3000.0, 0, 0])) > 5e-3


def test_origin_in_a_reference_system() -> None:
    corner = COQUET.to_crs(27700, np.array([[12.0, 34, 5]]))
    assert np.allclose(LocalFrame.at(27700, corner[0]).from_crs(27700, corner), 0, atol=2e-3)


@pytest.mark.parametrize(("call", "said"), [
    (lambda: COQUET.from_geodetic(np.array([[-1.892, 55.335, 110]])), "latitude and longitude are swapped"),
    (lambda: LocalFrame(-123.1, 49.2, 0), "-123.1 and longitude 49.2 are out of range, they look swapped"),
    (lambda: LocalFrame(200, 200, 0), "within 90 and 180 degrees"),
    (lambda: LocalFrame(math.nan, 0, 0), "finite"),
    (lambda: COQUET.from_geodetic(np.zeros((1, 3))), "km from the origin"),
    (lambda: COQUET.from_crs(32630, COQUET.to_crs(32630, PLACES)[:, [1, 0, 2]]), "easting and northing are swapped"),
    (lambda: COQUET.from_crs(32632, COQUET.to_crs(32630, PLACES)), "km from the origin"),
    (lambda: COQUET.from_crs(999999, PLACES), "EPSG:999999 is not a reference system"),
    (lambda: COQUET.from_crs("wgs", PLACES), "must be an EPSG code"),
    (lambda: COQUET.from_crs(9518, PLACES), "heights are given apart"),
    (lambda: COQUET.from_crs(4978, PLACES), "not a projected or geographic system"),
    (lambda: COQUET.from_crs(32630, np.full((1, 3), 1e40)), "out of the range"),
    (lambda: LocalFrame.at("local", np.zeros(3)), "need an EPSG code"),
])
def test_what_is_refused(call: object, said: str) -> None:
    assert callable(call)
    with pytest.raises(InputError, match=re.escape(said)) as raised:
        call()
    assert "\n" not in str(raised.value)


def test_missing_grid_is_said() -> None:
    """OSTN15 is not in the wheel; UTM on WGS 84 needs none."""
    assert crs_doubt(32630) is None
    assert crs_doubt("local") is None
    doubt = crs_doubt(27700)
    assert doubt is None or "needs a grid" in doubt  # where the grid is installed, there is no doubt


@pytest.mark.parametrize(("latitude", "longitude", "zone"), [
    (45.0, 8.0, "EPSG:32632"), (-33.9, 18.4, "EPSG:32734"), (10.0, 180.0, "EPSG:32660"), (0.0, -180.0, "EPSG:32601")])
def test_the_zone_of_utm(latitude: float, longitude: float, zone: str) -> None:
    assert LocalFrame(latitude, longitude, 0.0).utm == zone


def test_one_map_lies_in_another_as_on_the_earth() -> None:
    one, other = LocalFrame(46.2, 7.1, 400.0), LocalFrame(46.4, 7.9, -30.0)
    places_m = np.array([[10.0, -20, 5], [300, 200, 900], [-4000, 100, 0]])
    R, t = one.from_map(other)
    np.testing.assert_allclose(places_m @ R.T + t, one.from_geodetic(other.to_geodetic(places_m)), atol=1e-6)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
