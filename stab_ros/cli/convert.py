"""`stab-ros convert`: any recording into an MCAP bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, progress_bar, quiet_libraries, tell, warn
from stab_ros.cli.options import INPUT, add_force, command, positive_float, positive_int
from stab_ros.core.text import counted


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "convert", "turn any recording into an MCAP bag")
    parser.add_argument("input", type=Path, metavar="INPUT", help=INPUT)
    parser.add_argument("output", type=Path, metavar="OUTPUT.mcap", help="the bag to write")
    parser.add_argument("--topic", metavar="T", help="for a video or folder: the topic of the images (default "
                        "/camera/image_raw); for a bag: the one topic to convert (default: all)")
    parser.add_argument("--fps", type=positive_float, metavar="F", help="frame rate of a video or folder")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames of a video or folder")
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.jobs.convert import Conversion, convert

    job = Conversion(options.input, options.output, options.topic, options.fps, options.limit, options.force)
    with quiet_libraries(), progress_bar("messages") as progress:
        done = convert(job, progress)
    warn(done.warnings)
    tell(f"{counted(done.messages, 'message')}\nbag: {job.output}")
    return DONE
