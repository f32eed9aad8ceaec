"""`stab-ros record`: live topics into an MCAP bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.options import add_force, command
from stab_ros.cli.ros import needs_ros


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "record", "record live topics into an MCAP bag (needs ROS 2)")
    parser.add_argument("output", type=Path, metavar="OUT.mcap", help="the bag to write; Ctrl-C ends it")
    parser.add_argument("topics", nargs="+", metavar="TOPIC", help="of any installed type")
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    with needs_ros("record"):
        from stab_ros.nodes.bag_recorder import record

        return record({"output": str(options.output), "topics": options.topics, "overwrite": options.force})
