"""Turns the telemetry of a drone or a receiver into a bag: NavSatFix, and the attitudes of gimbal and drone."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from datetime import timezone, tzinfo
from operator import itemgetter
from pathlib import Path
from typing import TypeVar

from stab_ros.core.errors import InputError
from stab_ros.core.progress import Progress
from stab_ros.core.text import are, counted
from stab_ros.core.types import FloatArray
from stab_ros.io.attitude_message import Attitude, imu_cdr, quaternion_cdr
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import IMU, NAV_SAT_FIX, QUATERNION_STAMPED
from stab_ros.io.fix_message import Fix, fix_cdr, read_fix
from stab_ros.io.outputs import check_output
from stab_ros.io.repeated import measured
from stab_ros.io.telemetry import TELEMETRY, read_telemetry
from stab_ros.io.telemetry_clock import TelemetryClock, Timing, clock_of, stamps_of
from stab_ros.io.telemetry_mending import HIGHEST_M, mended
from stab_ros.io.telemetry_record import Record, Recorded
from stab_ros.io.topics import DEFAULT_NAMESPACE, FIX_TOPIC, GIMBAL_TOPIC, IMU_TOPIC, topic_in

_CLOCKS = {TelemetryClock.VIDEO: "stamps are 1 s + the time since the first frame of the video, as those of its frames",
           TelemetryClock.UTC: "stamps are in UTC"}
_S = TypeVar("_S", Fix, Attitude)


@dataclass(frozen=True)
class Telemetry:
    """What to turn into a bag.

    Attributes:
        sources: .srt, .pos and .csv files; positions are taken from the first that tells them, as are the attitudes of
            the gimbal and those of the drone.
        output: the bag to write.
        namespace: of its topics.
        timing: how messages are stamped.
        zone: of dates in a file that do not name theirs; None: UTC, which is warned of where it matters.
        home_height_m: height of the place of take-off: fixes get it plus the height above it; None: the file's height.
        swap: the files have longitude for latitude, and the other way round.
        force: overwrite the output.
    """

    sources: tuple[Path, ...]
    output: Path
    namespace: str = DEFAULT_NAMESPACE
    timing: Timing = field(default_factory=Timing)
    zone: tzinfo | None = None
    home_height_m: float | None = None
    swap: bool = False
    force: bool = False


@dataclass(frozen=True)
class Converted:
    """What was written.

    Attributes:
        counts: number of messages of each topic.
        first: the first fix; None: there is none.
        notes: how the files were taken, one line each.
        warnings: what was left out or is in doubt, one line each.
    """

    counts: dict[str, int]
    first: Fix | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class _File:
    """What a file tells, in the order of the stamps. notes, warnings: without its name."""

    path: Path
    clock: TelemetryClock
    records: list[tuple[int, Record]]
    notes: list[str]
    warnings: list[str]


@dataclass(frozen=True)
class _Stream:
    """The messages of one topic, with their stamps."""

    name: str
    msgtype: str
    messages: Sequence[tuple[int, bytes]]


def convert_telemetry(job: Telemetry, progress: Progress) -> Converted:
    """Runs the job.

    Raises:
        InputError: an argument or a file is unusable; no output remains.
        WorkError: the bag could not be finished; the readable part remains under its `.partial` name.
    """
    for source in job.sources:
        if not source.exists():
            raise InputError(f"{source}: no such file, it must be {TELEMETRY}")
        check_output(job.output, ".mcap", source, job.force)
    files = [_read(job, source, progress) for source in job.sources]
    _check_clocks(files)
    streams = [*_fix_stream(job, files), *_gimbal_stream(job, files), *_body_stream(job, files)]
    _write(job, streams)
    first = next((read_fix(stream.messages[0][1]) for stream in streams if stream.msgtype == NAV_SAT_FIX), None)
    return Converted({stream.name: len(stream.messages) for stream in streams}, first,
                     tuple(f"{file.path}: {line}" for file in files for line in file.notes),
                     tuple(f"{file.path}: {line}" for file in files for line in file.warnings))


def _read(job: Telemetry, source: Path, progress: Progress) -> _File:
    recorded = mended(read_telemetry(source, job.zone or timezone.utc, progress), job.swap)
    clock, warnings = clock_of(recorded, job.timing), list(recorded.warnings)
    dated = clock is TelemetryClock.UTC or (job.timing.start_ns is not None and not recorded.of_video)
    if dated and recorded.zoneless and job.zone is None:
        warnings.append("its dates name no time zone and are taken as UTC, --time-zone tells another")
    try:
        records = _in_order(recorded, job.timing, warnings)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    return _File(source, clock, records, [*recorded.notes, _CLOCKS[clock]], warnings)


def _check_clocks(files: Sequence[_File]) -> None:
    """Raises InputError where the stamps of two files are of two clocks."""
    other = next((file for file in files if file.clock is not files[0].clock), None)
    if other is not None:
        raise InputError(f"{other.path}: counts in {other.clock.value} time and {files[0].path} in "
                         f"{files[0].clock.value} time; --start, when the first frame was taken, makes them one")


def _telling(files: Sequence[_File], tells: Callable[[Record], bool], what: str) -> _File | None:
    """The first file that tells it; None: none does."""
    telling = [file for file in files if any(tells(record) for _, record in file.records)]
    for file in telling[1:]:
        file.notes.append(f"its {what} are not taken, those of {telling[0].path} are")
    return telling[0] if telling else None


def _in_order(recorded: Recorded, timing: Timing, warnings: list[str]) -> list[tuple[int, Record]]:
    """The records by their stamps, none of which comes twice or lies before 0.

    Raises:
        InputError: no record tells anything, there are no times for the stamps, or all lie before 0.
    """
    if not any(record.tells for record in recorded.records):
        raise InputError(f"holds no position that can be one; {'; '.join(recorded.warnings)}")
    stamps, doubts = stamps_of(recorded, timing)
    by_stamp: dict[int, Record] = {}
    for stamp_ns, record in zip(stamps, recorded.records, strict=True):
        by_stamp.setdefault(stamp_ns, record)
    late = [stamp_ns for stamp_ns in by_stamp if stamp_ns >= 0]
    if not late:
        raise InputError("all its moments lie before the first frame of the video, --start or --offset-s is wrong")
    warnings += doubts
    if len(late) < len(by_stamp):
        warnings.append(counted(len(by_stamp) - len(late), "moment before the first frame of the video is left out",
                                "moments before the first frame of the video are left out"))
    if len(by_stamp) < len(stamps):
        warnings.append(counted(len(stamps) - len(by_stamp), "moment has the time of an earlier one and is left out",
                                "moments have the time of an earlier one and are left out"))
    if late != sorted(late):
        warnings.append("its moments are not in the order of time, they are put in it")
    return [(stamp_ns, by_stamp[stamp_ns]) for stamp_ns in sorted(late)]


def _heights(records: Sequence[Record], home_height_m: float | None, warnings: list[str]) -> list[float]:
    """Heights of the fixes, m: those of the file, or those above the place of take-off on top of `home_height_m`."""
    above = [record.above_takeoff_m for record in records]
    told = [record.height_m for record in records]
    relative = any(map(math.isfinite, above))
    heights = told
    if home_height_m is not None and abs(home_height_m) > HIGHEST_M:
        raise InputError(f"--home-height: {home_height_m:g} m, it must lie within {HIGHEST_M:g} m")
    if home_height_m is not None and relative:
        heights = [home_height_m + height_m for height_m in above]
    elif home_height_m is not None:
        warnings.append("it tells no heights above the place of take-off, --home-height is not used")
    elif relative and not any(map(math.isfinite, told)):
        warnings.append("its heights count from the place of take-off, --home-height puts them above the ellipsoid")
        heights = above
    missing = sum(map(math.isnan, heights))
    if missing:
        warnings.append(f"{missing} of {counted(len(heights), 'position')} {are(missing)} without a height")
    return heights


def _fix_stream(job: Telemetry, files: Sequence[_File]) -> list[_Stream]:
    file = _telling(files, lambda record: record.placed, "positions")
    if file is None:
        files[0].warnings.append("there are no positions to be written, only attitudes")
        return []
    placed = [(stamp_ns, record) for stamp_ns, record in file.records if record.placed]
    heights = _heights([record for _, record in placed], job.home_height_m, file.warnings)
    fixes = [Fix(stamp_ns, record.latitude_deg, record.longitude_deg, height_m, record.covariance_m2, record.status,
                 "gps") for (stamp_ns, record), height_m in zip(placed, heights, strict=True)]
    values = [(fix.latitude_deg, fix.longitude_deg, repr(fix.height_m)) for fix in fixes]
    return [_stream(topic_in(job.namespace, FIX_TOPIC), NAV_SAT_FIX, fixes, values, fix_cdr, file.notes)]


def _gimbal_stream(job: Telemetry, files: Sequence[_File]) -> list[_Stream]:
    file = _telling(files, lambda record: record.gimbal is not None, "attitudes of the gimbal")
    if file is None:
        return []
    turns = [(stamp_ns, record.gimbal) for stamp_ns, record in file.records]
    return [_attitude_stream(topic_in(job.namespace, GIMBAL_TOPIC), QUATERNION_STAMPED, turns, "gimbal", quaternion_cdr,
                             file.notes)]


def _body_stream(job: Telemetry, files: Sequence[_File]) -> list[_Stream]:
    file = _telling(files, lambda record: record.body is not None, "attitudes of the drone")
    if file is None:
        return []
    turns = [(stamp_ns, record.body) for stamp_ns, record in file.records]
    return [_attitude_stream(topic_in(job.namespace, IMU_TOPIC), IMU, turns, "base_link", imu_cdr, file.notes)]


def _attitude_stream(name: str, msgtype: str, turns: Sequence[tuple[int, FloatArray | None]], frame_id: str,
                     cdr: Callable[[Attitude], bytes], notes: list[str]) -> _Stream:
    attitudes = [Attitude(stamp_ns, q, frame_id=frame_id) for stamp_ns, q in turns if q is not None]
    values = [tuple(attitude.map_q_body.tolist()) for attitude in attitudes]
    return _stream(name, msgtype, attitudes, values, cdr, notes)


def _stream(name: str, msgtype: str, samples: Sequence[_S], values: Sequence[Hashable], cdr: Callable[[_S], bytes],
            notes: list[str]) -> _Stream:
    """The messages of the samples that were measured and not repeated."""
    places = measured(values)
    if repeated := len(samples) - len(places):
        notes.append(f"{repeated} of {counted(len(samples), 'value')} of {name} {are(repeated)} repeated, not "
                     f"measured, and {are(repeated)} left out")
    return _Stream(name, msgtype, [(samples[place].stamp_ns, cdr(samples[place])) for place in places])


def _write(job: Telemetry, streams: Sequence[_Stream]) -> None:
    with BagWriter(job.output, overwrite=job.force) as writer:
        for stream in streams:
            writer.add_topic(topic_of(stream.name, stream.msgtype))
        messages = ((stamp_ns, stream.name, data) for stream in streams for stamp_ns, data in stream.messages)
        for stamp_ns, name, data in sorted(messages, key=itemgetter(0)):
            writer.write(name, stamp_ns, stamp_ns, data)
