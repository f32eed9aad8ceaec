"""Points of the map as latitude, longitude and height, by rotation into the earth-centred frame (EPSG 4978).

A computation of its own, by which those of the package can be checked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pyproj import Transformer

from stab_ros.core.types import FloatArray


@dataclass(frozen=True)
class Origin:
    """Where the map's origin lies: WGS 84, degrees, and height above the ellipsoid, m."""

    latitude_deg: float = 55.3328
    longitude_deg: float = -2.0431
    height_m: float = 151.0

    def to_geodetic(self, points_m: FloatArray) -> FloatArray:
        """Latitude and longitude, degrees, and height above the ellipsoid, m, (N, 3), of points (N, 3) of the map."""
        at = _geocentric(np.array([[self.latitude_deg, self.longitude_deg, self.height_m]]))
        x, y, z = (at + points_m @ self._earth_R_map.T).T
        return np.column_stack(Transformer.from_crs(4978, 4979).transform(x, y, z))

    def to_map(self, geodetic: FloatArray) -> FloatArray:
        """The inverse of `to_geodetic`: (N, 3), m."""
        at = _geocentric(np.array([[self.latitude_deg, self.longitude_deg, self.height_m]]))
        return np.asarray((_geocentric(geodetic) - at) @ self._earth_R_map)

    @property
    def _earth_R_map(self) -> FloatArray:
        latitude, longitude = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        (c, s), (cl, sl) = ((math.cos(a), math.sin(a)) for a in (latitude, longitude))
        return np.array([[-sl, -s * cl, c * cl], [cl, -s * sl, c * sl], [0, c, s]])


def _geocentric(geodetic: FloatArray) -> FloatArray:
    return np.column_stack(Transformer.from_crs(4979, 4978).transform(*geodetic.T))
