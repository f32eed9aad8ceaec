"""`stab-ros recover`: the readable part of a damaged MCAP file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, tell, warn
from stab_ros.cli.options import add_force, command
from stab_ros.core.text import counted


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "recover", "save what can be read of a broken .mcap")
    parser.add_argument("broken", type=Path, metavar="BROKEN.mcap", help="what a crash or a full disk left")
    parser.add_argument("fixed", type=Path, metavar="FIXED.mcap", help="the bag to write")
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.outputs import check_output
    from stab_ros.jobs.recover import recover

    check_output(options.fixed, ".mcap", options.broken, options.force)
    saved = recover(options.broken, options.fixed, options.force)
    warn(saved.warnings)
    tell(f"{counted(saved.messages, 'message')} on {counted(saved.topics, 'topic')}\nbag: {options.fixed}")
    return DONE
