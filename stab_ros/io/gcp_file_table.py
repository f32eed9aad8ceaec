"""What a file says of ground control points, and what its column headers mean."""

from __future__ import annotations

import re
from dataclasses import dataclass

from stab_ros.core.types import FloatArray

FORM = "name,x,y,X,Y,Z (pixels, then east, north, up), or name,x,y,lat,lon,height"
MOST_POINTS = 10_000
_PLACES = {  # header, in small letters and without units: what it holds
    "name": "name", "id": "name", "gcp": "name", "point": "name", "label": "name", "nr": "name",
    "u": "px", "col": "px", "column": "px", "px": "px", "pixel_x": "px", "image_x": "px", "x_px": "px", "x_image": "px",
    "v": "py", "row": "py", "py": "py", "pixel_y": "py", "image_y": "py", "y_px": "py", "y_image": "py",
    "e": "east", "east": "east", "easting": "east", "x_m": "east", "map_x": "east", "x_map": "east",
    "n": "north", "north": "north", "northing": "north", "y_m": "north", "map_y": "north", "y_map": "north",
    "z": "up", "up": "up", "z_m": "up", "height": "up", "h": "up", "elevation": "up", "altitude": "up", "alt": "up",
    "ele": "up", "map_z": "up", "z_map": "up",
    "lat": "lat", "latitude": "lat", "lon": "lon", "lng": "lon", "long": "lon", "longitude": "lon", "longtitude": "lon",
}
_UNIT = re.compile(r"(.*?) ?(?:[\[(](.*)[\])])?", re.DOTALL)
_CASED = {"x": "px", "y": "py", "X": "east", "Y": "north", "Z": "up"}
_IN_PIXELS, _IN_METRES = {"x": "px", "y": "py"}, {"x": "east", "y": "north", "z": "up"}


@dataclass(frozen=True, eq=False)
class GcpTable:
    """What a file says of control points.

    Attributes:
        names: of each; G1, G2, ... where the file has none.
        image_px: (N, 2) float64, as written, but KLT-IV's less 1.
        places: (N, 3) float64: east, north, up in the units of the reference system; longitude, latitude, height where
            `geographic`; the third is NaN where the file has no heights.
        geographic: whether the file has latitudes and longitudes.
        crs: "EPSG:nnnn" where the file names one.
        remarks: how it was read, where that is not plain: one line each.
    """

    names: tuple[str, ...]
    image_px: FloatArray
    places: FloatArray
    geographic: bool = False
    crs: str | None = None
    remarks: tuple[str, ...] = ()


def meaning(header: str) -> str:
    """What a column or property holds: name, px, py, east, north, up, lat or lon; "" for what is not known."""
    parts = _UNIT.fullmatch(" ".join(header.split()).strip('" '))
    bare, unit = parts.groups() if parts else (header, None)
    if unit and unit.lower().startswith(("px", "pix")):
        return _IN_PIXELS.get(bare.lower(), "")
    if unit and unit.lower().startswith("m"):
        return _IN_METRES.get(bare.lower()) or _PLACES.get(bare.lower(), "")
    return _CASED.get(bare) or _PLACES.get(bare.lower().replace(" ", "_"), "")
