"""`stab-ros warm-up`: compiles all kernels ahead of time."""

from __future__ import annotations

import argparse
from typing import Any

from stab_ros.cli.console import DONE, tell
from stab_ros.cli.options import command


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "warm-up", "compile what nodes and commands need, so that their first start is quick")
    parser.set_defaults(run=run)


def run(_options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.jobs.compiling import warm_up

    tell(warm_up())
    return DONE
