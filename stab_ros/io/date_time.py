"""Dates and times in text, exact to the ns, and the time that GPS counts."""

from __future__ import annotations

import itertools
import re
from datetime import datetime, timedelta, timezone, tzinfo
from typing import NamedTuple
from zoneinfo import ZoneInfo

from stab_ros.core.errors import InputError

SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
WEEK_NS = 7 * DAY_NS
_FRACTION = r"(?:[.,](\d[\d,]*))?"
# as in 2022-08-07 13:40:40,774,808 (ms, us), 2017.8.5 14:11:51, 2020/08/25 12:03:00.125, 2025-01-02T03:04:05.6+10:00
_DATE = re.compile(r"(?<!\d)(\d{4})[-./](\d{1,2})[-./](\d{1,2})(?:[ T]+|,\s*)(\d{1,2}):(\d{2}):(\d{2})" + _FRACTION
                   + r"\s?(Z\b|UTC\b|[+-]\d{2}:?\d{2}\b)?")
_TIME = re.compile(r"\s*(\d{1,2}):(\d{2}):(\d{2})" + _FRACTION + r"\s*")
_ZONE = re.compile(r"([+-])(\d{1,2}):?(\d{2})")
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
GPS_EPOCH_NS = int((datetime(1980, 1, 6, tzinfo=timezone.utc) - _EPOCH).total_seconds()) * SECOND_NS
# UTC days on which GPS began to be one more second ahead of UTC (IERS Bulletin C; the last known: none until mid 2027)
_LEAPS = ("1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01",
          "1992-07-01", "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01",
          "2009-01-01", "2012-07-01", "2015-07-01", "2017-01-01")
_LEAPS_NS = [int((datetime.fromisoformat(day).replace(tzinfo=timezone.utc) - _EPOCH).total_seconds()) * SECOND_NS
             for day in _LEAPS]


class Date(NamedTuple):
    """A date. time_ns: since 1970, for a clock of UTC; zoned: the text tells its zone, which is applied."""

    time_ns: int
    zoned: bool

    def utc_ns(self, zone: tzinfo) -> int:
        """The UTC time, ns since 1970; zone: where the text tells none."""
        return self.time_ns if self.zoned else utc_of_local(self.time_ns, zone)


def find_date(text: str) -> Date | None:
    """The first date with a time in a text; None: there is none, or it is no day of the calendar."""
    match = _DATE.search(text)
    if match is None:
        return None
    year, month, day, hour, minute, second = map(int, match.groups()[:6])
    try:
        days = (datetime(year, month, day, tzinfo=timezone.utc) - _EPOCH).days
    except ValueError:
        return None
    if hour > 24 or minute > 59 or second > 60:
        return None
    zone = match.group(8)
    time_ns = days * DAY_NS + _of_day(hour, minute, second, match.group(7))
    return Date(time_ns - (_zone_ns(zone) if zone else 0), zone is not None)


def time_of_day_ns(text: str) -> int | None:
    """The time of a day without a date, as 23:59:59.9; None: it is none."""
    match = _TIME.fullmatch(text)
    if match is None:
        return None
    hour, minute, second = map(int, match.groups()[:3])
    return _of_day(hour, minute, second, match.group(4)) if hour <= 24 and minute < 60 and second <= 60 else None


def _of_day(hour: int, minute: int, second: int, fraction: str | None) -> int:
    digits = (fraction or "").replace(",", "")[:9]
    return (hour * 3600 + minute * 60 + second) * SECOND_NS + int(digits.ljust(9, "0"))


def _zone_ns(zone: str) -> int:
    found = _ZONE.fullmatch(zone)
    if found is None:
        return 0
    sign, hours, minutes = found.groups()
    return (int(hours) * 60 + int(minutes)) * 60 * SECOND_NS * (-1 if sign == "-" else 1)


def zone_named(name: str) -> tzinfo:
    """A time zone: UTC, +10:00 or a name as Europe/London.

    Raises:
        InputError: there is none of this name.
    """
    if name.upper() in ("UTC", "Z"):
        return timezone.utc
    try:
        return timezone(timedelta(seconds=_zone_ns(name) // SECOND_NS)) if _ZONE.fullmatch(name) else ZoneInfo(name)
    except (OSError, ValueError, KeyError) as error:  # KeyError: no such zone; ValueError: a day and more; no name
        raise InputError(f"{name!r} is no time zone, it must be as UTC, +10:00 or Europe/London") from error


def utc_of_local(local_ns: int, zone: tzinfo) -> int:
    """The UTC time, ns since 1970, when clocks in a zone show a date."""
    whole, rest = divmod(local_ns, SECOND_NS)
    shown = datetime(1970, 1, 1, tzinfo=zone) + timedelta(seconds=whole)
    offset = shown.utcoffset() or timedelta()
    return whole * SECOND_NS + rest - int(offset.total_seconds()) * SECOND_NS


def utc_named(text: str, zone: tzinfo) -> int:
    """The UTC time, ns since 1970, of a date; zone: where the text names none.

    Raises:
        InputError: it is no date.
    """
    date = find_date(text)
    if date is None:
        raise InputError(f"{text!r} is no date with a time, it must be as 2025-07-14T10:31:07.2Z")
    return date.utc_ns(zone)


def gps_minus_utc_s(gps_ns: int) -> int:
    """Leap seconds by which GPS is ahead of UTC; gps_ns: since 1970 as a GPS clock counts, without leap seconds."""
    ahead = (start_ns + count * SECOND_NS for count, start_ns in enumerate(_LEAPS_NS, 1))
    return sum(1 for _ in itertools.takewhile(lambda start_ns: start_ns <= gps_ns, ahead))


def utc_of_gps(gps_ns: int) -> int:
    """The UTC time, ns since 1970, of a time of GPS."""
    return gps_ns - gps_minus_utc_s(gps_ns) * SECOND_NS
