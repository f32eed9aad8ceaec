"""Faults of positions in files of telemetry: what can be mended is, the rest is left out, and both are said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stab_ros.core.text import are, counted
from stab_ros.io.fix_message import fault_of_place
from stab_ros.io.telemetry_record import Record, Recorded

HIGHEST_M = 100_000.0  # above and below zero: farther, nothing flies
_METRES_PER_DEGREE = 111_195.0  # of latitude
_COARSE_M = 1.0
_ROUNDING_DEG = 1e-9
_FLIGHT_RAD = 0.001  # 6 km, in one recording


def mended(recorded: Recorded, swap: bool) -> Recorded:
    """The records with positions that are such. swap: the file has longitude for latitude and the other way round."""
    records, notes, warnings = recorded.records, list(recorded.notes), list(recorded.warnings)
    if swap or _swapped(records):
        records = [replace(record, latitude_deg=record.longitude_deg, longitude_deg=record.latitude_deg)
                   for record in records]
        if not swap:
            warnings.append("its latitudes are beyond 90 degrees: they are taken as longitudes, and the longitudes as "
                            "latitudes")
    if _in_radians(records):
        records = [replace(record, latitude_deg=math.degrees(record.latitude_deg),
                           longitude_deg=math.degrees(record.longitude_deg)) for record in records]
        warnings.append("its positions are taken as radians, as degrees they would lie in the Gulf of Guinea")
    faults = [fault_of_place(record.latitude_deg, record.longitude_deg) if record.placed else "" for record in records]
    found = [fault for fault in faults if fault]
    if found:
        warnings.append(f"{len(found)} of {counted(len(records), 'position')} {are(len(found))} left out, the first: "
                        f"{found[0]}")
        records = [replace(record, latitude_deg=math.nan, longitude_deg=math.nan) if fault else record
                   for record, fault in zip(records, faults, strict=True)]
    high = [height_m for record in records for height_m in _heights(record) if abs(height_m) > HIGHEST_M]
    if high:
        warnings.append(f"{counted(len(high), 'height is', 'heights are')} left out, the first: it is {high[0]:.4g} m, "
                        f"it must lie within {HIGHEST_M:g} m")
        records = [_without_heights(record) if any(abs(h) > HIGHEST_M for h in _heights(record)) else record
                   for record in records]
    return Recorded(recorded.of_video, recorded.zoneless, records, notes, [*warnings, *_coarse(records)])


def _heights(record: Record) -> tuple[float, float]:
    return record.height_m, record.above_takeoff_m


def _without_heights(record: Record) -> Record:
    """Without those that are none."""
    height_m, above_m = (math.nan if abs(value) > HIGHEST_M else value for value in _heights(record))
    return replace(record, height_m=height_m, above_takeoff_m=above_m)


def _places(records: Sequence[Record]) -> np.ndarray:
    """(n, 2): latitude and longitude of the positions that are not zero."""
    places = np.array([(record.latitude_deg, record.longitude_deg) for record in records if record.placed])
    return places[places.any(axis=1)] if len(places) else places.reshape(0, 2)


def _swapped(records: Sequence[Record]) -> bool:
    """Whether most latitudes are none, and all would be as longitudes."""
    places = np.abs(_places(records))
    return bool(len(places) and (places[:, 0] > 90).mean() > 0.5 and places[:, 1].max() <= 90)


def _in_radians(records: Sequence[Record]) -> bool:
    """As the firmware of some drones writes them; a flight beside 0 degrees north and east is over the sea."""
    places = _places(records)
    if len(places) < 2 or (np.abs(places) > (math.pi / 2, math.pi)).any():
        return False
    return bool((np.ptp(places, axis=0) < _FLIGHT_RAD).all())


def _coarse(records: Sequence[Record]) -> list[str]:
    """That positions have so few digits that they are steps on the ground."""
    places = _places(records)
    for digits in range(1, 6):
        if len(places) and np.abs(places - np.round(places, digits)).max() < _ROUNDING_DEG:
            step_m = _METRES_PER_DEGREE / 10**digits
            if step_m > _COARSE_M:
                return [f"its positions have {counted(digits, 'decimal')}, they are told in steps of {step_m:.3g} m"]
    return []
