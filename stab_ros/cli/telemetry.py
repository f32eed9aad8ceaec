"""`stab-ros telemetry`: what a drone or a receiver says of where it was, into an MCAP bag."""

from __future__ import annotations

import argparse
import math
from datetime import timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stab_ros.cli.console import DONE, note, progress_bar, quiet_libraries, tell, warn
from stab_ros.cli.options import add_force, command, finite, namespace, positive_float
from stab_ros.core.text import counted

if TYPE_CHECKING:
    from stab_ros.io.fix_message import Fix

_MOST_S = 1e9  # 31 years


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "telemetry", "turn positions and attitudes of a drone into an MCAP bag")
    parser.add_argument("inputs", type=Path, nargs="+", metavar="FLIGHT", help="a DJI .srt, an RTKLIB .pos or a .csv; "
                        "of several, positions are taken from the first that tells them, and attitudes likewise")
    parser.add_argument("output", type=Path, metavar="OUTPUT.mcap", help="the bag to write")
    parser.add_argument("--clock", choices=("video", "utc"), help="what stamps count: video, 1 s + the time since its "
                        "first frame (default where the file or --start tells that), or utc (default elsewhere)")
    parser.add_argument("--start", metavar="DATE", help="when the first frame of the video was taken, as "
                        "2025-07-14T10:31:07.2Z")
    parser.add_argument("--fps", type=positive_float, metavar="F", help="frame rate of the video: time codes are "
                        "rounded to its frames")
    parser.add_argument("--time-zone", metavar="Z", help="of dates that do not name theirs, as +10:00 or Europe/London "
                        "(default UTC)")
    parser.add_argument("--offset-s", type=_offset, default=0.0, metavar="S", help="added to all stamps")
    parser.add_argument("--home-height", type=finite, metavar="M", help="height of the place of take-off: take this "
                        "plus the height above it, in place of the height that the file tells")
    parser.add_argument("--swap", action="store_true", help="the files have longitude for latitude, and the reverse")
    parser.add_argument("--namespace", type=namespace, default="/camera", metavar="NS",
                        help="of the topics (default /camera)")
    add_force(parser)
    parser.set_defaults(run=run)


def _offset(text: str) -> float:
    offset_s = finite(text)
    if abs(offset_s) > _MOST_S:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number of seconds within {_MOST_S:g}")
    return offset_s


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.date_time import utc_named, zone_named
    from stab_ros.io.telemetry_clock import TelemetryClock, Timing
    from stab_ros.jobs.telemetry import Telemetry, convert_telemetry

    zone = None if options.time_zone is None else zone_named(options.time_zone)
    timing = Timing(None if options.clock is None else TelemetryClock(options.clock),
                    None if options.start is None else utc_named(options.start, zone or timezone.utc), options.fps,
                    round(options.offset_s * 1e9))
    job = Telemetry(tuple(options.inputs), options.output, options.namespace, timing, zone, options.home_height,
                    options.swap, options.force)
    with quiet_libraries(), progress_bar("moments") as progress:
        done = convert_telemetry(job, progress)
    note(done.notes)
    warn(done.warnings)
    tell(*(f"{name}: {counted(count, 'message')}" for name, count in done.counts.items()))
    if done.first is not None:
        tell(f"first position: {_place(done.first)}")
    tell(f"bag: {job.output}")
    return DONE


def _place(fix: Fix) -> str:
    """As people write it, so that they see where the file says that they were."""
    north, east = ("N" if fix.latitude_deg >= 0 else "S"), ("E" if fix.longitude_deg >= 0 else "W")
    height = f", {fix.height_m:.3f} m" if math.isfinite(fix.height_m) else ""
    return f"{abs(fix.latitude_deg):.7f} {north} {abs(fix.longitude_deg):.7f} {east}{height}"
