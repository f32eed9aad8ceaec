"""What a file says of ground control points, and what its column headers mean."""

from __future__ import annotations

import re
from dataclasses import dataclass

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.core.types import FloatArray
from stab_ros.io.column_qualifiers import Qualifier, qualifier_of
from stab_ros.io.length_units import LENGTH_PATTERN, LENGTHS_TEXT, metres_of

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
_UNIT = re.compile(r"(.*?)[ _]*(?:[\[(] *(.*?) *[\])]|(?<=[ _])"
                   rf"(px|pix|pixels?|deg|degrees?|{LENGTH_PATTERN}))?", re.DOTALL | re.IGNORECASE)
_CASED = {"x": "px", "y": "py", "X": "east", "Y": "north", "Z": "up"}
_IN_PIXELS, _IN_LENGTHS = {"x": "px", "y": "py"}, {"x": "east", "y": "north", "z": "up"}
_LONGEST = 100  # header, where longer ones have no meaning
_PIXELS = re.compile(r"pix|px", re.IGNORECASE)
_DEGREES = re.compile(r"deg|°|dec|dd", re.IGNORECASE)
_AXIS_OF = {"lon": "east", "lat": "north"}
_TOWARDS = {"east": "to the east", "north": "to the north", "up": "upwards", "px": "to the right", "py": "downwards"}


@dataclass(frozen=True, eq=False)
class GcpTable:
    """What a file says of control points.

    Attributes:
        names: of each; G1, G2, ... where the file has none.
        image_px: (N, 2) float64, as written, but KLT-IV's less 1.
        places: (N, 3) float64: east, north, up, metres where the file names a unit, else in that of the reference
            system; longitude, latitude, height where `geographic`; the third is NaN where the file has no heights.
        geographic: whether the file has latitudes and longitudes.
        crs: "EPSG:nnnn" where the file names one.
        remarks: how it was read, where that is not plain: one line each.
        unit_m: metres of the unit that the file names for east and north, which are metres here; None: it names none.
    """

    names: tuple[str, ...]
    image_px: FloatArray
    places: FloatArray
    geographic: bool = False
    crs: str | None = None
    remarks: tuple[str, ...] = ()
    unit_m: float | None = None


@dataclass(frozen=True)
class Column:
    """What a column holds.

    Attributes:
        meaning: name, px, py, east, north, up, lat or lon; "" for what is not known.
        metres: of one unit of a length, and 1 for all else.
        unit: of a length; "" where none is.
        header: as written.
    """

    meaning: str
    metres: float = 1.0
    unit: str = ""
    header: str = ""


def column_of(header: str) -> Column:
    """What a column holds, by its header.

    Raises:
        InputError: its unit is none of what it holds, or it runs along another axis.
    """
    what, (_, beside) = meaning(header), _split(header)
    unit, axis = beside.unit, _AXIS_OF.get(what, what)
    if beside.axis and axis in _TOWARDS and beside.axis != axis:
        raise InputError(f"the column {one_line(header)[:60]!r} must hold numbers that grow {_TOWARDS[axis]}")
    if what in ("east", "north", "up"):
        return Column(what, _factor(header, unit), unit, header)
    units, right = {"px": (_PIXELS, "px"), "py": (_PIXELS, "px"), "lat": (_DEGREES, "degrees"),
                    "lon": (_DEGREES, "degrees")}.get(what, (None, ""))
    if units is not None and unit and not units.match(unit):
        raise _unknown(header, right)
    return Column(what, header=header)


def meaning(header: str) -> str:
    """What a column or property holds, as of `Column`."""
    bare, beside = _split(header)
    what = _CASED.get(bare) or _PLACES.get(bare.lower().replace(" ", "_"), "")
    if bare.lower() in _IN_LENGTHS and beside.axis in _TOWARDS:
        return beside.axis
    if _PIXELS.match(beside.unit) or beside.of_image:
        return _IN_PIXELS.get(bare.lower()) or (what if what in ("px", "py") else "")
    return _IN_LENGTHS.get(bare.lower(), what) if metres_of(beside.unit) or beside.of_map else what


def _split(header: str) -> tuple[str, Qualifier]:
    """Name of a column, and what stands beside it: in brackets, or as a unit after the last space or _."""
    text = " ".join(header.split()).strip('" ')
    parts = _UNIT.fullmatch(text) if len(text) < _LONGEST else None
    return (parts[1], qualifier_of(parts[2] or parts[3] or "")) if parts else (header, Qualifier())


def _factor(header: str, unit: str) -> float:
    metres = metres_of(unit) if unit else 1.0
    if metres is None:
        raise _unknown(header, LENGTHS_TEXT)
    return metres


def _unknown(header: str, right: str) -> InputError:
    return InputError(f"the column {one_line(header)[:60]!r} is in a unit that is not known, it must be {right}")
