"""Dates in text against datetime, leap seconds against the table of the system (IERS)."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stab_ros.core.errors import InputError
from stab_ros.io.date_time import (
    SECOND_NS,
    find_date,
    gps_minus_utc_s,
    time_of_day_ns,
    utc_named,
    utc_of_gps,
    utc_of_local,
    zone_named,
)

IERS = Path("/usr/share/zoneinfo/leap-seconds.list")
NTP_S = 2_208_988_800  # 1900 to 1970
TAI_MINUS_GPS_S = 19


def unix_ns(text: str, rest_ns: int = 0) -> int:
    return int(datetime.fromisoformat(text).replace(tzinfo=timezone.utc).timestamp()) * SECOND_NS + rest_ns


@pytest.mark.parametrize(("text", "time_ns"), [
    ("FrameCnt : 1\n2022-08-07 13:40:40,774,808\n[iso]", unix_ns("2022-08-07T13:40:40", 774_808_000)),
    ("HOME(1,2) 2017.8.5 14:11:51", unix_ns("2017-08-05T14:11:51")),
    ("2021-12-25 12:27:52.373", unix_ns("2021-12-25T12:27:52", 373_000_000)),
    ("2020/08/25 12:03:00.125", unix_ns("2020-08-25T12:03:00", 125_000_000)),
    ("2024-05-05T23:59:59.123456789Z", unix_ns("2024-05-05T23:59:59", 123_456_789)),
    ("2025-01-02T03:04:05.6+10:00", unix_ns("2025-01-01T17:04:05", 600_000_000)),
    ("2025-01-02 03:04:05-0330", unix_ns("2025-01-02T06:34:05"))])
def test_dates_of_all_kinds_are_read_to_the_ns(text: str, time_ns: int) -> None:
    date = find_date(text)
    assert date is not None
    assert date.time_ns == time_ns


@pytest.mark.parametrize("text", ["", "2024-02-30 01:02:03", "2024-13-01 01:02:03", "2024-01-01 25:00:00",
                                  "2024-01-01 10:61:00", "2024-01-01", "0000-01-01 00:00:00"])
def test_what_is_no_date_is_none(text: str) -> None:
    assert find_date(text) is None
    with pytest.raises(InputError, match="no date with a time, it must be as"):
        utc_named(text, timezone.utc)


@settings(deadline=None, derandomize=True)
@given(st.datetimes(datetime(1970, 1, 2), datetime(2200, 1, 1)), st.sampled_from(
    ["UTC", "+10:00", "-03:30", "Europe/London", "Australia/Brisbane", "America/New_York"]))
def test_local_dates_become_utc_as_datetime_has_it(local: datetime, name: str) -> None:
    expected = local.replace(tzinfo=zone_named(name)).astimezone(timezone.utc)
    since = expected - datetime(1970, 1, 1, tzinfo=timezone.utc)
    assert utc_named(f"{local:%Y-%m-%d %H:%M:%S.%f}", zone_named(name)) == (
        (since.days * 86400 + since.seconds) * SECOND_NS + since.microseconds * 1000)


@pytest.mark.parametrize("name", ["Mars/Olympus", "+99:00", "", "../etc/passwd", "a\0b"])
def test_no_zone_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="no time zone, it must be as UTC"):
        zone_named(name)


def test_summer_time_is_applied() -> None:
    london = zone_named("Europe/London")
    assert utc_of_local(unix_ns("2025-07-14T10:00:00"), london) == unix_ns("2025-07-14T09:00:00")
    assert utc_of_local(unix_ns("2025-01-14T10:00:00"), london) == unix_ns("2025-01-14T10:00:00")


def test_times_of_day() -> None:
    assert time_of_day_ns("23:59:59.25") == (86_399 * 4 + 1) * SECOND_NS // 4
    assert time_of_day_ns("9:61:00") is time_of_day_ns("1234") is None


@pytest.mark.skipif(not IERS.exists(), reason="the system has no table of leap seconds")
def test_leap_seconds_are_those_of_the_iers() -> None:
    steps = [tuple(map(int, line.split()[:2])) for line in IERS.read_text(encoding="utf-8").splitlines()
             if line.strip() and not line.startswith("#")]
    for ntp_s, tai_minus_utc_s in steps:
        ahead_s = tai_minus_utc_s - TAI_MINUS_GPS_S
        if ahead_s > 0:
            gps_ns = (ntp_s - NTP_S + ahead_s) * SECOND_NS
            assert (gps_minus_utc_s(gps_ns - 1), gps_minus_utc_s(gps_ns)) == (ahead_s - 1, ahead_s)
    assert gps_minus_utc_s(unix_ns("2026-01-01T00:00:00")) == steps[-1][1] - TAI_MINUS_GPS_S


def test_gps_time_of_a_known_second() -> None:
    assert utc_of_gps(unix_ns("2026-01-14T21:17:29")) == unix_ns("2026-01-14T21:17:11")
