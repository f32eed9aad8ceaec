"""What `stab-ros discharge` does: a discharge from files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.discharge.doubts import surface_doubts
from stab_ros.discharge.measure import measure
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.georeferencing.level_doubts import late_level, stale_level
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.section_file import Heights, read_section
from stab_ros.jobs.discharge_input import Line, MeasuredVelocities, in_map, read_measured, section_of
from stab_ros.velocimetry.vectors import Vectors

_NS = 1e9
_ONE_PLACE_M = 0.1  # of origins that are typed with as many digits as needed


@dataclass(frozen=True, eq=False)
class DischargeJob:
    """What is measured, from which files.

    Attributes:
        velocity: table or recording of velocities.
        section: table of the cross-section.
        config: methods and uncertainties.
        wse_m: water surface elevation; None: as the recording says.
        line: where the distances of the section are in the map; None: it has places.
        heights: what the heights of the section are; None: as its header says.
        crs: reference system of the section's places, "EPSG:nnnn"; None: the map.
        origin: of the map; None: as the recording says.
        topic: of the velocities; None: the only one.
    """

    velocity: Path
    section: Path
    config: DischargeConfig = field(default_factory=DischargeConfig)
    wse_m: float | None = None
    line: Line | None = None
    heights: Heights | None = None
    crs: str | None = None
    origin: LocalFrame | None = None
    topic: str | None = None


@dataclass(frozen=True, eq=False)
class MeasuredDischarge:
    """What came out.

    Attributes:
        job: what was asked.
        discharge: with its uncertainty.
        vectors: all that were read.
        level: where the water level is from, in words.
        stage_known: whether its water level is an elevation; not so for depths without one.
        warnings: one line each, with those of the discharge.
    """

    job: DischargeJob
    discharge: Discharge
    vectors: Vectors
    level: str
    stage_known: bool
    warnings: tuple[str, ...]


def discharge_from_files(job: DischargeJob) -> MeasuredDischarge:
    """Reads velocities and section, and measures.

    Raises:
        InputError: a file cannot be read, the water level is missing, or velocities and section do not meet.
    """
    measured = read_measured(job.velocity, job.topic)
    table = read_section(job.section)
    line = job.line
    if job.crs is not None:
        table, line = in_map(table, line, job.crs, measured.origin or job.origin)
    level = _level(job, measured)
    section, wse_m, said = section_of(job.section, table, line, job.heights, level.wse_m)
    try:
        found = measure(measured.vectors, section, wse_m, job.config)
    except InputError as error:
        raise InputError(f"{job.velocity}, {job.section}: {error}") from error
    warnings = (*measured.warnings, *_other_origin(job, measured.origin), *said, *level.warnings, *found.warnings)
    return MeasuredDischarge(job, found, measured.vectors, level.origin, level.wse_m is not None, warnings)


def _other_origin(job: DischargeJob, recorded: LocalFrame | None) -> tuple[str, ...]:
    """That the origin which is given is not that of the velocities."""
    if job.origin is None or recorded is None:
        return ()
    given = np.array([[job.origin.latitude_deg, job.origin.longitude_deg, recorded.height_m]])
    away_m = float(np.hypot(*recorded.from_geodetic(given)[0, :2]))
    if away_m < _ONE_PLACE_M:
        return ()
    place = f"{recorded.latitude_deg:.8g},{recorded.longitude_deg:.8g}"
    return (f"{job.velocity}: the origin that is given lies {away_m:.3g} m from that of its map, {place}, which is "
            "taken",)


@dataclass(frozen=True)
class _Level:
    wse_m: float | None
    origin: str
    warnings: tuple[str, ...] = ()


def _level(job: DischargeJob, measured: MeasuredVelocities) -> _Level:
    """The water level: the one given, else the newest recorded one, else that at which the vectors lie."""
    if job.wse_m is not None:
        return _Level(job.wse_m, "given", _contradiction(job, measured, job.wse_m))
    if measured.levels and len(measured.vectors):
        return _recorded(job, measured)
    if measured.used_wse_m is not None:
        return _Level(measured.used_wse_m, "that of the velocities")
    return _Level(None, "the surface from which depths count")


def _recorded(job: DischargeJob, measured: MeasuredVelocities) -> _Level:
    end_ns = int(measured.vectors.end_ns.max())
    before = [level for level in measured.levels if level[0] <= end_ns]
    stamp_ns, wse_m = before[-1] if before else measured.levels[0]
    doubts = stale_level((end_ns - stamp_ns) / _NS) if before else late_level((stamp_ns - end_ns) / _NS)
    return _Level(wse_m, "recorded", (*(f"{job.velocity}: {doubt}" for doubt in doubts),
                                      *_contradiction(job, measured, wse_m)))


def _contradiction(job: DischargeJob, measured: MeasuredVelocities, wse_m: float) -> tuple[str, ...]:
    return surface_doubts(measured.used_wse_m, wse_m, job.config.wse_sigma_m)
