"""Telemetry in a table (.csv): one row a moment, the first line names the columns and their units.

A name is as `latitude`, `height_m`, `time (ms)` or `gimbal_pitch(degrees)`, as in the tables of Airdata, or as DatCon
has it; QUANTITIES has all that are known, others are ignored. Between cells are commas, semicolons or tabs; numbers may
have decimal commas.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import tzinfo
from decimal import Decimal, InvalidOperation
from types import MappingProxyType

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.progress import Progress
from stab_ros.core.text import counted, one_line
from stab_ros.core.types import FloatArray
from stab_ros.io.date_time import DAY_NS, find_date, time_of_day_ns
from stab_ros.io.length_units import LENGTHS
from stab_ros.io.srt_telemetry import attitude_of
from stab_ros.io.telemetry_record import Record, Recorded

ANGLES: Mapping[str, float] = MappingProxyType({
    "deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "rad": math.degrees(1), "radian": math.degrees(1),
    "radians": math.degrees(1)})
TIMES: Mapping[str, int] = MappingProxyType({
    "s": 10**9, "sec": 10**9, "second": 10**9, "seconds": 10**9, "ms": 10**6, "millisecond": 10**6,
    "milliseconds": 10**6, "us": 10**3, "microseconds": 10**3, "ns": 1, "nanoseconds": 1, "utc": 0})
_UNITS = {**LENGTHS, **ANGLES, **TIMES}


@dataclass(frozen=True)
class Quantity:
    """What a column may hold. names: in any case and with any marks between words; units: and their factors."""

    names: tuple[str, ...]
    units: Mapping[str, float] = field(default_factory=dict)


QUANTITIES: Mapping[str, Quantity] = MappingProxyType({
    "time": Quantity(("time", "timestamp", "t", "datetime", "utc", "time_utc", "datetime_utc", "unix_time", "unix",
                      "stamp", "GPS:dateTimeStamp", "Clock:offsetTime", "offset_time"), TIMES),
    "date": Quantity(("date",)),
    "latitude": Quantity(("latitude", "lat", "GPS(0):Lat", "GPS:Lat"), ANGLES),
    "longitude": Quantity(("longitude", "longtitude", "lon", "lng", "long", "GPS(0):Long", "GPS:Long"), ANGLES),
    "height": Quantity(("height", "altitude", "alt", "abs_alt", "elevation", "ellipsoidal_height",
                        "altitude_above_sea_level", "GPS(0):heightMSL", "GPS:heightMSL"), LENGTHS),
    "above_takeoff": Quantity(("rel_alt", "relative_altitude", "height_above_takeoff", "above_takeoff",
                               "General:relativeHeight"), LENGTHS),
    "sigma_east": Quantity(("sigma_east", "sde", "sd_east", "std_east"), LENGTHS),
    "sigma_north": Quantity(("sigma_north", "sdn", "sd_north", "std_north"), LENGTHS),
    "sigma_up": Quantity(("sigma_up", "sdu", "sd_up", "std_up"), LENGTHS),
    "gimbal_yaw": Quantity(("gimbal_yaw", "gb_yaw", "gimbal_heading"), ANGLES),
    "gimbal_pitch": Quantity(("gimbal_pitch", "gb_pitch"), ANGLES),
    "gimbal_roll": Quantity(("gimbal_roll", "gb_roll"), ANGLES),
    "yaw": Quantity(("yaw", "heading", "compass_heading", "drone_yaw", "IMU_ATTI(0):yaw"), ANGLES),
    "pitch": Quantity(("pitch", "drone_pitch", "IMU_ATTI(0):pitch"), ANGLES),
    "roll": Quantity(("roll", "drone_roll", "IMU_ATTI(0):roll"), ANGLES),
    "qx": Quantity(("qx",)), "qy": Quantity(("qy",)), "qz": Quantity(("qz",)), "qw": Quantity(("qw",)),
})
_UNIT = re.compile(r"^(.*?)\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]\s*$")
_UNIX_NS = 10**17  # of a time since 1970, in ns: 1973; a smaller one counts from the start of the video
_MOST_NS = 2**62
_UTC = "utc"
_Q = ("qx", "qy", "qz", "qw")
_TEXT = "the first line must name its columns, as time,latitude,longitude,height_m"


@dataclass(frozen=True)
class _Column:
    at: int
    unit: str


def read_csv(text: str, zone: tzinfo, progress: Progress) -> Recorded:
    """The records of a table; zone: of dates that do not name theirs.

    Raises:
        InputError: the first line names neither positions nor attitudes, or no time.
    """
    lines = text.splitlines(keepends=True)
    while lines and (not lines[0].strip() or lines[0].lower().startswith(("sep=", "#"))):
        del lines[0]
    header = lines[0] if lines else ""
    mark = max(",;\t", key=header.count)
    rows = csv.reader(lines, delimiter=mark, skipinitialspace=True)
    table = _Table(_columns(next(rows, [])), zone)
    recorded, broken = Recorded(), []
    try:
        for cells in rows:
            if any(map(str.strip, cells)):
                try:
                    recorded.records.append(table.record(cells))
                except ValueError:
                    broken.append(rows.line_num)
            progress(rows.line_num, len(lines))
    except csv.Error as error:
        raise InputError(f"is no table below line {rows.line_num} ({error})") from error
    recorded.zoneless = table.zoneless
    if table.of_day:
        recorded.notes.append("its times of day have no date, they count from the first row")
    if broken:
        without = counted(len(broken), "line holds no moment and is", "lines hold no moment and are")
        recorded.warnings.append(f"{without} left out, the first is line {broken[0]}")
    return recorded


def _columns(header: Sequence[str]) -> dict[str, list[_Column]]:
    """The columns of each quantity, by what the header names."""
    found: dict[str, list[_Column]] = {}
    for at, cell in enumerate(header):
        name, unit = _named(cell)
        quantity = _KNOWN.get(name)
        if quantity is None:
            continue
        if unit and unit not in QUANTITIES[quantity].units:
            units = ", ".join(QUANTITIES[quantity].units) or "none"
            raise InputError(f"its column {one_line(cell)[:40]!r} has an unknown unit, it must be one of {units}")
        found.setdefault(quantity, []).append(_Column(at, unit))
    placed = {"latitude", "longitude"} <= found.keys()
    turned = any(set(names) <= found.keys() for names in (("gimbal_yaw", "gimbal_pitch"), ("yaw", "pitch"), _Q))
    missing = "time" if not {"time", "date"} & found.keys() else "" if placed or turned else "latitude and longitude"
    if missing:
        has = one_line(", ".join(header))[:100]
        raise InputError(f"has no column of {missing}, its first line is {has!r}; {_TEXT}")
    return found


def _squeezed(name: str) -> str:
    """`gimbalPitch`, `Gimbal Pitch` and `gimbal_pitch` are one name."""
    return re.sub(r"[\W_]+", "", name.lower())


_KNOWN = {_squeezed(name): quantity for quantity, kind in QUANTITIES.items() for name in kind.names}


def _named(cell: str) -> tuple[str, str]:
    """Name, squeezed, and unit of a column: in brackets, or after the last _."""
    match = _UNIT.match(cell.strip())
    name, unit = match.groups() if match else (cell.strip(), "")
    base, _, last = name.rpartition("_")
    if not unit and _squeezed(name) not in _KNOWN and last.lower() in _UNITS:
        name, unit = base, last
    squeezed, unit = _squeezed(name), unit.lower()
    return squeezed, unit or (_UTC if squeezed.endswith(_UTC) else "")


class _Table:
    """Reads one row after another: times of day without a date count from the first row, and go on after midnight."""

    def __init__(self, columns: Mapping[str, list[_Column]], zone: tzinfo) -> None:
        self._columns, self._zone = columns, zone
        self.zoneless = False  # dates that name no time zone were met
        self._first_ns: int | None = None  # of the times of day
        self._day_ns, self._last_ns = 0, 0

    @property
    def of_day(self) -> bool:
        """Whether there were times of day without a date."""
        return self._first_ns is not None

    def record(self, cells: Sequence[str]) -> Record:
        """The record of a row.

        Raises:
            ValueError: it has no time, or a cell is no number.
        """
        since_start_ns, utc_ns = self._times(cells)
        if since_start_ns is None and utc_ns is None:
            raise ValueError("no time")
        return Record(
            since_start_ns, utc_ns, self._value("latitude", cells), self._value("longitude", cells),
            self._value("height", cells), self._value("above_takeoff", cells), self._covariance(cells),
            gimbal=self._angles("gimbal_", cells), body=self._quaternion(cells))

    def _times(self, cells: Sequence[str]) -> tuple[int | None, int | None]:
        """Time since the start and UTC, ns: a table may have both, as it may have several columns of times."""
        times: dict[str, int] = {}
        for text, unit in self._texts(cells):
            for kind, time_ns in self._time(text, unit):
                times.setdefault(kind, time_ns)
        if not {"since_start", "utc"} & times.keys() and "of_day" in times:
            return self._past_midnight(times["of_day"]), None
        return times.get("since_start"), times.get("utc")

    def _texts(self, cells: Sequence[str]) -> list[tuple[str, str]]:
        """The texts of times with their units; a day is put before the time of day."""
        texts = [(_cell(cells, column.at), column.unit) for column in self._columns.get("time", [])]
        of_day = next((text for text, _ in texts if time_of_day_ns(text) is not None), "00:00:00")
        days = [_cell(cells, column.at) for column in self._columns.get("date", [])]
        return [*((day if find_date(day) else f"{day} {of_day}", "") for day in days), *texts]

    def _time(self, text: str, unit: str) -> list[tuple[str, int]]:
        """What a text tells, ns, and whether that counts from the start, from 1970 or from midnight; none: nothing.

        Raises:
            ValueError: it is no time.
        """
        date, of_day_ns = find_date(text), time_of_day_ns(text)
        if date is not None:
            zoned = date.zoned or unit == _UTC
            self.zoneless |= not zoned
            return [("utc", date.time_ns if zoned else date.utc_ns(self._zone))]
        if of_day_ns is not None:
            return [("of_day", of_day_ns)]
        time_ns = _time_ns(text, unit) if text else None
        return [] if time_ns is None else [("utc" if time_ns >= _UNIX_NS else "since_start", time_ns)]

    def _past_midnight(self, of_day_ns: int) -> int:
        if self._first_ns is None:
            self._first_ns = of_day_ns
        if of_day_ns + DAY_NS // 2 < self._last_ns:
            self._day_ns += DAY_NS
        self._last_ns = of_day_ns
        return self._day_ns + of_day_ns - self._first_ns

    def _value(self, quantity: str, cells: Sequence[str]) -> float:
        for column in self._columns.get(quantity, []):
            text = _cell(cells, column.at)
            if text and text.lower() not in ("nan", "n/a", "null", "-"):
                return _number(text) * _UNITS.get(column.unit, 1.0)
        return math.nan

    def _covariance(self, cells: Sequence[str]) -> FloatArray | None:
        sigmas = np.array([self._value(f"sigma_{axis}", cells) for axis in ("east", "north", "up")])
        return np.diag(sigmas**2) if np.isfinite(sigmas).all() and sigmas.any() else None

    def _angles(self, kind: str, cells: Sequence[str]) -> FloatArray | None:
        yaw, pitch, roll = (self._value(f"{kind}{angle}", cells) for angle in ("yaw", "pitch", "roll"))
        if not (math.isfinite(yaw) and math.isfinite(pitch)):
            return None
        return attitude_of(yaw, pitch, roll if math.isfinite(roll) else 0.0)

    def _quaternion(self, cells: Sequence[str]) -> FloatArray | None:
        q = np.array([self._value(name, cells) for name in _Q])
        if not np.isfinite(q).all():
            return self._angles("", cells)
        length = float(np.linalg.norm(q))
        if not abs(length - 1) < 0.01:
            raise ValueError("no quaternion")
        return q / length


def _cell(cells: Sequence[str], at: int) -> str:
    return cells[at].strip() if at < len(cells) else ""


def _number(text: str) -> float:
    """A finite number, also with a decimal comma."""
    number = float(text if "." in text else text.replace(",", ".", 1))
    if not math.isfinite(number):
        raise ValueError("not finite")
    return number


def _time_ns(text: str, unit: str) -> int:
    """A time in ns, exactly; without a unit it is told by its size: seconds, ms, us or ns since 1970, else seconds."""
    try:
        number = Decimal(text if "." in text else text.replace(",", ".", 1))
    except InvalidOperation as error:
        raise ValueError("no number") from error
    if not number.is_finite() or abs(number) > _MOST_NS:
        raise ValueError("no time")
    scale = TIMES.get(unit) or next(scale for limit, scale in (
        (10**11, 10**9), (10**14, 10**6), (10**17, 10**3), (_MOST_NS, 1)) if abs(number) <= limit)
    time_ns = int(number * scale)
    if abs(time_ns) > _MOST_NS:
        raise ValueError("no time")
    return time_ns
