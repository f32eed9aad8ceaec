"""Telemetry in the subtitles of DJI's drones (.SRT), in the variants since 2016.

    [latitude: 41.424724] [longtitude: 2.234156] [rel_alt: 1.300 abs_alt: 132.860] [gb_yaw: -67.6 gb_pitch: -90.0 ...]
    GPS (-58.851745, -34.237922, 15), HOME (...), H 85.80m, F.PRY (2.7°, -7.0°, 110.1°), G.PRY (-24.4°, 0.0°, 110.4°)
    GPS(149.0251,-20.2533,16) BAROMETER:1.9          GPS(36.6146,-6.1120,0.0M) BAROMETER:0.3M
    GPS(W: 121.7458, N: 48.0771, 17.20m), of Autel

GPS holds longitude and latitude, the other way round where its third value has the unit M (Matrice 300), else that is
the number of satellites. The angles are pitch, roll and yaw. DJI describes none of it; these are the variants of the
samples of JuanIrache/DJI_SRT_Parser, and the values agree with those that it reads.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from datetime import tzinfo

from stab_ros.core.progress import Progress
from stab_ros.core.text import are, counted
from stab_ros.core.types import FloatArray
from stab_ros.imaging.heading import map_R_body
from stab_ros.imaging.pose import quaternion_of
from stab_ros.io.date_time import find_date
from stab_ros.io.srt_blocks import Block, srt_blocks
from stab_ros.io.telemetry_record import Record, Recorded

_BRACKETS = re.compile(r"\[([^\[\]\n]*)\]")
_NUMBER = r"[-+]?\d{1,12}(?:[.,]\d{1,12})?"
_VALUE = re.compile(rf"(?<![A-Za-z_])([A-Za-z_]{{1,30}})\s*[:=]\s*({_NUMBER})(?![\d.,])")
_GPS = re.compile(r"\b(?:GPS|RTK)\s*\(([^()\n]*)\)")
_ANGLES = re.compile(r"\b([FG])\.PRY\s*\(([^()\n]*)\)")
_HEIGHT = re.compile(rf"\b(?:H|(?:BAROMETER|Hb)\s*:)\s*({_NUMBER})\s*(?:m\b|M\b|\s)")
_NUMBERS = re.compile(rf"{_NUMBER}(?![\d.])")
_LETTERS = re.compile(r"\b([NSEW])\s*:")
_METRES = re.compile(r"\d\s*M\s*$")
_LATITUDE, _LONGITUDE = ("latitude", "lat"), ("longitude", "longtitude", "lon", "lng")
_HEIGHTS, _ABOVE_TAKEOFF = ("abs_alt", "altitude", "alt"), ("rel_alt",)
_GIMBAL, _BODY = ("gb", "gimbal"), ("drone", "flight", "f")


def read_srt(text: str, zone: tzinfo, progress: Progress) -> Recorded:
    """The records of the subtitles; zone: of their dates."""
    recorded = Recorded(of_video=True)
    blocks = list(srt_blocks(text))
    incomplete = 0
    for number, block in enumerate(blocks, 1):
        date = find_date(block.text)
        recorded.zoneless |= date is not None and not date.zoned
        record = _record(block, None if date is None else date.utc_ns(zone))
        if record.tells and (record.since_start_ns, record.utc_ns) != (None, None):
            recorded.records.append(record)
        else:
            incomplete += 1
        progress(number, len(blocks))
    if incomplete and recorded.records:
        recorded.warnings.append(f"{incomplete} of {counted(len(blocks), 'block')} {are(incomplete)} left "
                                 "out, holding no time with a position or an attitude")
    return recorded


def _record(block: Block, utc_ns: int | None) -> Record:
    text = block.text
    values = {name.lower(): _number(number) for inside in _BRACKETS.findall(text)
              for name, number in _VALUE.findall(inside)}
    angles = {kind: _triple(inside) for kind, inside in _ANGLES.findall(text)}
    place = _first(values, _LATITUDE), _first(values, _LONGITUDE), _first(values, _HEIGHTS)
    if math.isnan(place[0]) and math.isnan(place[1]):
        place = _place(text)
    height = _HEIGHT.search(text)
    above = _first(values, _ABOVE_TAKEOFF) if height is None else _number(height.group(1))
    return Record(
        block.start_ns, utc_ns, *place, above,
        gimbal=_attitude(values, _GIMBAL, angles.get("G")), body=_attitude(values, _BODY, angles.get("F")))


def _place(text: str) -> tuple[float, float, float]:
    """Latitude, longitude and, of Autel's drones, height of GPS(...)."""
    found = _GPS.search(text)
    inside = "" if found is None else found.group(1)
    numbers, letters = _numbers(inside), _LETTERS.findall(inside)
    if len(numbers) < 2:
        return math.nan, math.nan, math.nan
    if letters:
        return _lettered(numbers, letters)
    first, second = numbers[:2]
    return (first, second, math.nan) if _METRES.search(inside) else (second, first, math.nan)


def _lettered(numbers: list[float], letters: list[str]) -> tuple[float, float, float]:
    """A place with the letters of the compass before its numbers; none where they do not fit."""
    degrees = {letter: -number if letter in "SW" else number for letter, number in zip(letters, numbers, strict=False)}
    latitude = degrees.get("N", degrees.get("S", math.nan))
    longitude = degrees.get("E", degrees.get("W", math.nan))
    return latitude, longitude, numbers[2] if len(numbers) > 2 else math.nan


def _numbers(text: str) -> list[float]:
    """Numbers between commas; `41,4247, 2,2341, 15` has decimal commas, as no point and a space after the others."""
    if "." in text:
        return [_number(part) for part in _NUMBERS.findall(text.replace(",", " "))]
    return [_number(part) for part in _NUMBERS.findall(text)]


def _triple(text: str) -> tuple[float, float, float] | None:
    numbers = _numbers(text)
    return (numbers[0], numbers[1], numbers[2]) if len(numbers) == 3 else None


def _attitude(values: Mapping[str, float], names: tuple[str, ...],
              pitch_roll_yaw: tuple[float, float, float] | None) -> FloatArray | None:
    for name in names:
        yaw, pitch = values.get(f"{name}_yaw", math.nan), values.get(f"{name}_pitch", math.nan)
        if math.isfinite(yaw) and math.isfinite(pitch):
            return attitude_of(yaw, pitch, values.get(f"{name}_roll", 0.0))
    if pitch_roll_yaw is None:
        return None
    pitch, roll, yaw = pitch_roll_yaw
    return attitude_of(yaw, pitch, roll)


def attitude_of(yaw_deg: float, pitch_deg: float, roll_deg: float) -> FloatArray:
    """Quaternion x, y, z, w of DJI's angles: yaw clockwise from north, pitch -90 at nadir, roll to the right."""
    return quaternion_of(map_R_body(math.radians(yaw_deg), math.radians(pitch_deg), math.radians(roll_deg)))


def _first(values: Mapping[str, float], names: tuple[str, ...]) -> float:
    return next((values[name] for name in names if name in values), math.nan)


def _number(text: str) -> float:
    return float(text.replace(",", "."))
