"""Positions as RTKLIB writes them (.pos): degrees, degrees, minutes and seconds, or ECEF; GPST, UTC or JST.

The line of `%` with the names of the columns tells the format (outsolheads in RTKLIB's solution.c). Where two axes are
correlated, a column such as sdne holds the square root of the size of the covariance, with its sign.
"""

from __future__ import annotations

import functools
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import tzinfo
from typing import TYPE_CHECKING

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.progress import Progress
from stab_ros.core.text import counted, one_line
from stab_ros.core.types import FloatArray
from stab_ros.io.date_time import GPS_EPOCH_NS, SECOND_NS, WEEK_NS, find_date, gps_minus_utc_s, utc_of_gps
from stab_ros.io.fix_message import FIX, GBAS_FIX, SBAS_FIX
from stab_ros.io.telemetry_record import Record, Recorded

if TYPE_CHECKING:
    from pyproj import Transformer

_DECIMALS_M = 1e-4
_JST_NS = 9 * 3600 * SECOND_NS
_QUALITIES = {1: ("fixed", GBAS_FIX), 2: ("float", GBAS_FIX), 3: ("SBAS", SBAS_FIX), 4: ("DGPS", GBAS_FIX),
              5: ("single", FIX), 6: ("PPP", SBAS_FIX)}
_ENU = (("sde",), ("sdn",), ("sdu",), ("sdne", "sden"), ("sdun", "sdnu"), ("sdeu", "sdue"))  # variances, en, nu, ue
_XYZ = (("sdx",), ("sdy",), ("sdz",), ("sdxy",), ("sdyz",), ("sdzx",))
_WANTED = "RTKLIB must write latitude, longitude and height, or ECEF (out-solformat llh or xyz)"


@dataclass(frozen=True)
class _Layout:
    """What the header says. columns: after the time, by name without unit; of degrees with minutes the first."""

    system: str
    columns: Mapping[str, int]
    separator: str | None
    sexagesimal: bool


def read_pos(text: str, zone: tzinfo, progress: Progress) -> Recorded:
    """The positions of a solution file; zone: not used, as the header names its time.

    Raises:
        InputError: there is no header, or it names what is no position on WGS 84.
    """
    lines = text.splitlines()
    layout = _layout(lines)
    recorded, qualities, broken = Recorded(), Counter[int](), []
    for number, line in enumerate(lines, 1):
        if line.strip() and not line.lstrip().startswith(("%", "+", "#")):
            try:
                quality, record = _record(line, layout)
            except ValueError:
                broken.append(number)
            else:
                qualities[quality] += 1
                recorded.records.append(record)
        progress(number, len(lines))
    if broken:
        without = counted(len(broken), "line holds no position and is", "lines hold no position and are")
        recorded.warnings.append(f"{without} left out, the first is line {broken[0]}")
    if recorded.records:
        recorded.notes.extend(_notes(layout, qualities, recorded.records[0]))
    if any("/geodetic" in line for line in lines if line.startswith("%")):
        recorded.warnings.append("its heights are above the geoid, a NavSatFix has them above the ellipsoid")
    return recorded


def _notes(layout: _Layout, qualities: Mapping[int, int], first: Record) -> list[str]:
    found = ", ".join(f"{count} {_QUALITIES[quality][0]}" for quality, count in sorted(qualities.items()))
    leap_s = gps_minus_utc_s(first.utc_ns or 0)
    times = f"GPS time, {leap_s} leap seconds ahead of UTC" if layout.system == "GPST" else layout.system
    return [f"its times are {times}", f"solutions: {found}"]


def _layout(lines: Sequence[str]) -> _Layout:
    """Raises InputError where no line names the columns of positions."""
    for line in lines:
        if not line.startswith("%"):
            continue
        if "=Tokyo" in line:
            raise InputError("its positions are in the Tokyo datum, they must be in WGS84 (out-solformat, datum)")
        if "e-baseline(m)" in line:
            raise InputError(f"holds distances from a base station; {_WANTED}")
        if "latitude(" in line or "x-ecef(m)" in line:
            return _layout_of(line)
    raise InputError(f"has no line of % that names its columns, as latitude(deg); {_WANTED}")


def _layout_of(header: str) -> _Layout:
    separator = next((mark for mark in (",", ";", "\t") if mark in header), None)
    names = [name.strip() for name in header.lstrip("% ").split(separator)]
    sexagesimal = "latitude(d'" in header
    columns: dict[str, int] = {}
    at = 0
    for name in names[1:]:
        short = re.sub(r"-?(ecef)?\(.*", "", name)
        columns[short] = at
        at += 3 if sexagesimal and short in ("latitude", "longitude") else 1
    system = next((known for known in ("GPST", "UTC", "JST") if known in names[0]), "")
    if not system:
        raise InputError(f"its times are in {one_line(names[0])[:20]!r}, they must be in GPST, UTC or JST")
    wanted = ("x", "y", "z") if "x" in columns else ("latitude", "longitude", "height")
    missing = next((name for name in wanted if name not in columns), None)
    if missing is not None:
        raise InputError(f"its line of % names no column {missing}; {_WANTED}")
    return _Layout(system, columns, separator, sexagesimal)


def _record(line: str, layout: _Layout) -> tuple[int, Record]:
    """The quality and the position in a line.

    Raises:
        ValueError: it is none.
    """
    cells = line.split() if layout.separator is None else re.split(rf"{layout.separator}|\s+", line.strip())
    cells = [cell.replace(",", ".") for cell in cells if cell]
    utc_ns = _utc_ns(cells[:2], layout.system)
    values = cells[2:]
    names = layout.columns
    quality = int(values[names["Q"]]) if names.get("Q", len(values)) < len(values) else 5
    if quality not in _QUALITIES:
        raise ValueError("no solution")
    latitude, longitude, height, covariance = (_ecef if "x" in names else _geodetic)(values, layout)
    if not (math.isfinite(latitude) and math.isfinite(longitude)):
        raise ValueError("no position")
    return quality, Record(None, utc_ns, latitude, longitude, height, covariance_m2=covariance,
                           status=_QUALITIES[quality][1])


def _utc_ns(cells: Sequence[str], system: str) -> int:
    if len(cells) < 2:
        raise ValueError("no time")
    date = find_date(" ".join(cells))
    time_ns = _week_ns(*cells) if date is None else date.time_ns
    if system == "GPST":
        return utc_of_gps(time_ns)
    return time_ns - (_JST_NS if system == "JST" else 0)


def _week_ns(week: str, second: str) -> int:
    """Time of a GPS week (never more than 4 digits) and a second in it."""
    whole, _, fraction = second.partition(".")
    if not (week.isdecimal() and len(week) <= 4 and whole.isdecimal() and int(whole) <= 604_800):
        raise ValueError("no time")
    return GPS_EPOCH_NS + int(week) * WEEK_NS + int(whole) * SECOND_NS + int(fraction[:9].ljust(9, "0"))


def _geodetic(values: Sequence[str], layout: _Layout) -> tuple[float, float, float, FloatArray | None]:
    at = layout.columns
    read = _sexagesimal if layout.sexagesimal else _decimal
    return (read(values, at["latitude"]), read(values, at["longitude"]), _decimal(values, at["height"]),
            _covariance(values, layout, _ENU))


def _ecef(values: Sequence[str], layout: _Layout) -> tuple[float, float, float, FloatArray | None]:
    x, y, z = (_decimal(values, layout.columns[axis]) for axis in "xyz")
    longitude, latitude, height = _to_geodetic().transform(x, y, z)
    covariance = _covariance(values, layout, _XYZ)
    if covariance is not None and math.isfinite(latitude):
        R = _enu_R_ecef(math.radians(latitude), math.radians(longitude))
        covariance = np.asarray(R @ covariance @ R.T)
    return latitude, longitude, height, covariance


@functools.cache
def _to_geodetic() -> Transformer:
    from pyproj import Transformer

    return Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


def _enu_R_ecef(latitude_rad: float, longitude_rad: float) -> FloatArray:
    """Rotation (3, 3) from ECEF to east, north and up at a place (Groves 2013, eq. 2.150)."""
    cp, sp, cl, sl = (math.cos(latitude_rad), math.sin(latitude_rad), math.cos(longitude_rad),
                      math.sin(longitude_rad))
    return np.array([[-sl, cl, 0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])


def _decimal(values: Sequence[str], at: int) -> float:
    if at >= len(values):
        raise ValueError("too short")
    return float(values[at])


def _sexagesimal(values: Sequence[str], at: int) -> float:
    degrees, minutes, seconds = (_decimal(values, at + k) for k in range(3))
    return math.copysign(abs(degrees) + minutes / 60 + seconds / 3600, degrees)


def _covariance(values: Sequence[str], layout: _Layout, axes: Sequence[Sequence[str]]) -> FloatArray | None:
    """(3, 3), m2, in the order of `axes`: three variances, and covariances of 0 and 1, 1 and 2, 2 and 0."""
    deviations = []
    for names in axes:
        at = next((layout.columns[name] for name in names if name in layout.columns), len(values))
        deviations.append(float(values[at]) if at < len(values) else 0.0)
    xx, yy, zz, xy, yz, zx = (math.copysign(deviation**2, deviation) for deviation in deviations)
    C = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    return _positive(C) if C.any() and np.isfinite(C).all() else None


def _positive(C: FloatArray) -> FloatArray:
    """The covariance itself; where it is none, as the file has but four decimals, the nearest one that they allow."""
    variances, axes = np.linalg.eigh(C)
    if variances[0] >= 0:
        return C
    return np.asarray(axes * np.maximum(variances, _DECIMALS_M**2) @ axes.T)
