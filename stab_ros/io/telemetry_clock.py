"""The stamps of telemetry: on the clock of a video, whose frames are stamped 1 s + frame/fps, or on that of UTC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from stab_ros.core.errors import InputError
from stab_ros.io.date_time import SECOND_NS
from stab_ros.io.telemetry_record import Record, Recorded

_YOUNG = 0.99  # share of dates of whole seconds that are older than the one that is taken
_DRIFT_S = 1.0  # by which dates and times since the start may differ at the end


class TelemetryClock(Enum):
    """What stamps count. VIDEO: 1 s + the time since its first frame; UTC: since 1970, as live cameras do."""

    VIDEO = "video"
    UTC = "utc"


@dataclass(frozen=True)
class Timing:
    """How stamps are made.

    Attributes:
        clock: None: the video's, where the file belongs to one or counts from a start or `start_ns` is given; else UTC.
        start_ns: UTC time of the first frame of the video; None: not known.
        fps: rate of the video: times since its start are rounded to those of its frames; None: they are not.
        offset_ns: added to all stamps.
    """

    clock: TelemetryClock | None = None
    start_ns: int | None = None
    fps: float | None = None
    offset_ns: int = 0


def stamps_of(recorded: Recorded, timing: Timing) -> tuple[list[int], list[str]]:
    """The stamp of each record, ns, and warnings.

    Raises:
        InputError: the file has no dates for stamps in UTC.
    """
    origin_ns, warnings = _origin(recorded, timing)
    utc = [_utc_ns(record, origin_ns) for record in recorded.records]
    if clock_of(recorded, timing) is TelemetryClock.UTC:
        stamps = [utc_ns for utc_ns in utc if utc_ns is not None]
        if len(stamps) < len(utc):
            raise InputError("has no dates, so stamps in UTC need --start, the time of the first frame of its video")
        return [stamp_ns + timing.offset_ns for stamp_ns in stamps], warnings
    counted = recorded.of_video or timing.start_ns is None  # by the file, which may have begun before the video
    zero_ns = origin_ns if counted else timing.start_ns
    if zero_ns is None:
        zero_ns = next((utc_ns for utc_ns in utc if utc_ns is not None), 0)
        if zero_ns:
            warnings.append("its first moment is taken as the first frame of the video, --start tells another")
    times = [_since_start_ns(record, utc_ns, zero_ns, counted, timing.fps)
             for record, utc_ns in zip(recorded.records, utc, strict=True)]
    return [SECOND_NS + time_ns + timing.offset_ns for time_ns in times], warnings


def clock_of(recorded: Recorded, timing: Timing) -> TelemetryClock:
    """The clock of the stamps."""
    counted = any(record.since_start_ns is not None for record in recorded.records)
    of_video = recorded.of_video or counted or timing.start_ns is not None
    return timing.clock or (TelemetryClock.VIDEO if of_video else TelemetryClock.UTC)


def _utc_ns(record: Record, origin_ns: int | None) -> int | None:
    counted = record.since_start_ns is not None and origin_ns is not None
    return (origin_ns or 0) + (record.since_start_ns or 0) if counted else record.utc_ns


def _since_start_ns(record: Record, utc_ns: int | None, zero_ns: int, counted: bool, fps: float | None) -> int:
    if record.since_start_ns is not None and (counted or utc_ns is None):
        return _on_frame(record.since_start_ns, fps)
    return (utc_ns or 0) - zero_ns


def _on_frame(time_ns: int, fps: float | None) -> int:
    """The time of the nearest frame: 1/30 s is 33 ms in a time code."""
    return time_ns if fps is None else round(round(time_ns * fps / SECOND_NS) * SECOND_NS / fps)


def _common(starts_ns: Sequence[int], recorded: Recorded) -> int:
    """The start that dates beside times since the start tell.

    Dates of whole seconds are up to a second old: those that have just begun tell it, up to outliers.
    """
    whole = all(record.utc_ns is None or record.utc_ns % SECOND_NS == 0 for record in recorded.records)
    return sorted(starts_ns)[int(len(starts_ns) * (_YOUNG if whole else 0.5))]


def _origin(recorded: Recorded, timing: Timing) -> tuple[int | None, list[str]]:
    """The UTC time from which times since the start count, as --start or else the dates beside them tell it."""
    both = [record.utc_ns - record.since_start_ns for record in recorded.records
            if record.utc_ns is not None and record.since_start_ns is not None]
    if timing.start_ns is not None and (recorded.of_video or not both):
        return timing.start_ns, []
    if not both:
        return None, []
    drift_s = (both[-1] - both[0]) / SECOND_NS
    return _common(both, recorded), (
        [f"its dates and its time codes differ by {drift_s:+.1f} s more at the end than at the beginning"]
        if abs(drift_s) > _DRIFT_S else [])
