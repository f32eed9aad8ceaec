"""`stab-ros info`: the content of a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, quiet_libraries, tell, warn
from stab_ros.cli.options import INPUT, command


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "info", "show what a recording holds")
    parser.add_argument("bag", type=Path, metavar="BAG", help=INPUT)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.jobs.info import describe

    with quiet_libraries():
        lines, warnings = describe(options.bag)
    warn(warnings)
    tell("\n".join(lines))
    return DONE
