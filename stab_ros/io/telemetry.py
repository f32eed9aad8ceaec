"""Files in which drones and receivers tell where they were, by the suffix of their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import tzinfo
from pathlib import Path
from types import MappingProxyType

from stab_ros.core.errors import InputError
from stab_ros.core.progress import Progress
from stab_ros.io.pos_file import read_pos
from stab_ros.io.srt_telemetry import read_srt
from stab_ros.io.telemetry_csv import read_csv
from stab_ros.io.telemetry_record import Recorded
from stab_ros.io.text_file import read_text


@dataclass(frozen=True)
class TelemetryKind:
    """A kind of file. holds, times: for the documentation."""

    name: str
    read: Callable[[str, tzinfo, Progress], Recorded]
    holds: str
    times: str


KINDS: Mapping[str, TelemetryKind] = MappingProxyType({
    ".srt": TelemetryKind("subtitles of DJI's drones", read_srt, "positions; of some drones the angles of gimbal and "
                          "body", "time codes since the first frame; some have dates, in a zone that is not told"),
    ".pos": TelemetryKind("solutions of RTKLIB", read_pos, "positions with covariance, as degrees, degrees-minutes-"
                          "seconds or ECEF", "GPST (leap seconds are taken off), UTC or JST, as the header says"),
    ".csv": TelemetryKind("a table, also of Airdata or DatCon", read_csv, "what its first line names: positions, "
                          "standard deviations, angles or a quaternion",
                          "seconds since the first frame, since 1970, or dates"),
})
TELEMETRY = "a DJI .srt, an RTKLIB .pos or a .csv"


def read_telemetry(path: Path, zone: tzinfo, progress: Progress) -> Recorded:
    """Reads a file of telemetry.

    Args:
        path: its suffix is one of KINDS.
        zone: of dates that do not name theirs.
        progress: called after each block or line.

    Returns:
        The records in the order of the file, with all their faults.

    Raises:
        InputError: missing, unreadable, of no such kind, or without one position or attitude.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file, it must be {TELEMETRY}")
    kind = KINDS.get(path.suffix.lower())
    if kind is None:
        raise InputError(f"{path}: is no telemetry by its name, it must be {TELEMETRY}")
    text = read_text(path, TELEMETRY)
    try:
        recorded = kind.read(text, zone, progress)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if not any(record.tells for record in recorded.records):
        why = "".join(f"; {warning}" for warning in recorded.warnings)
        raise InputError(f"{path}: holds no position and no attitude, it must be {kind.name}{why}")
    return recorded
