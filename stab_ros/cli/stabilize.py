"""`stab-ros stabilize`: a recording into a stabilised bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, note, progress_bar, quiet_libraries, tell, warn
from stab_ros.cli.options import INPUT, add_force, add_time, assignment, command, positive_float, positive_int
from stab_ros.core.text import counted


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "stabilize", "stabilise a recording into an MCAP bag")
    parser.add_argument("input", type=Path, metavar="INPUT", help=INPUT)
    parser.add_argument("output", type=Path, metavar="OUTPUT.mcap", help="the bag to write")
    parser.add_argument("--image-topic", metavar="T", help="which images, where a bag has several topics of them")
    parser.add_argument("--config", type=Path, metavar="FILE.yaml",
                        help="a ROS parameter file with parameters of the tracker")
    parser.add_argument("-p", dest="parameters", type=assignment, action="append", default=[], metavar="name:=value",
                        help="a parameter of the tracker; may be repeated, and overrides --config")
    parser.add_argument("--homographies", type=Path, metavar="H.csv", help="write a table of all homographies")
    parser.add_argument("--video", type=Path, metavar="V.mp4",
                        help="write the stabilised frames as a video, in which a lost frame repeats the one before")
    parser.add_argument("--no-image", action="store_true", help="leave image_stabilized out of the bag")
    parser.add_argument("--keep-raw", action="store_true", help="take the raw images over into the bag")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames")
    parser.add_argument("--fps", type=positive_float, metavar="F",
                        help="frame rate of a video or folder (default: the file's, else 25), and of --video")
    add_time(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.advice import by_reason
    from stab_ros.io.picture import Clock
    from stab_ros.jobs.compiling import compile_shown
    from stab_ros.jobs.stabilize import Job, stabilize
    from stab_ros.parameters.file import read_config
    from stab_ros.parameters.table import checked_values

    values = read_config(options.config) if options.config else {}
    values |= checked_values(dict(options.parameters))
    job = Job(options.input, options.output, values, options.image_topic, options.homographies, options.video,
              not options.no_image, options.keep_raw, options.limit, options.fps, options.force, Clock(options.time))
    with quiet_libraries(), progress_bar("frames") as progress:
        summary = stabilize(job, progress, compile_shown)
    note(summary.notes)
    warn(summary.warnings)
    tell(f"{counted(summary.frames, 'frame')}: {summary.tracked} tracked, {summary.lost.total()} lost, "
          f"{summary.frames / summary.duration_s:.1f} frames/s")
    if summary.lost:
        tell(f"lost {summary.lost.total()} of {summary.frames}: {by_reason(summary.lost)}")
    for name, path in (("bag", job.output), ("homographies", job.homographies), ("video", job.video)):
        if path is not None:
            tell(f"{name + ':':13} {path}")
    return DONE
