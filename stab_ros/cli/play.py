"""`stab-ros play`: a bag's messages over ROS 2."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.options import BAG, command, positive_float, positive_int, seconds
from stab_ros.cli.ros import needs_ros

_OPTIONS = ("rate", "loop", "start_offset", "clock", "wait_for_subscribers")


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "play", "publish a bag's messages live (needs ROS 2)")
    parser.add_argument("bag", type=Path, metavar="BAG", help=BAG)
    parser.add_argument("--rate", type=positive_float, metavar="R", help="times real time (default: 1)")
    parser.add_argument("--loop", action="store_true", default=None, help="start again at the end")
    parser.add_argument("--start-offset", type=seconds, metavar="S", help="skip the first S seconds")
    parser.add_argument("--clock", action="store_true", default=None, help="publish /clock, from the log times; "
                        "a /clock in the bag is left out then, as ros2 bag does")
    parser.add_argument("--wait-for-subscribers", type=positive_int, metavar="N",
                        help="begin once the image topics (without any: all topics) have N subscribers in total")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    given = {name: value for name, value in vars(options).items() if name in _OPTIONS and value is not None}
    with needs_ros("play"):
        from stab_ros.nodes.bag_player import play

        return play({"bag": str(options.bag), **given})
