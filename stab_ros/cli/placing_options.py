"""The options of commands that place frames on the water plane, and the parameters that they give."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stab_ros.cli.options import INPUT, add_force, add_time, assignment, positive_float, positive_int

if TYPE_CHECKING:
    from stab_ros.parameters.table import Table


def add_inputs(parser: argparse.ArgumentParser, node: str, tracker_prefix: str = "") -> None:
    """INPUT, OUT.mcap, and what places its frames.

    Args:
        parser: of the command.
        node: whose parameters --config and -p give.
        tracker_prefix: what may stand before a parameter of the tracker, where the node has others of the same names.
    """
    both = f" ({tracker_prefix}name:=value where both have the name)" if tracker_prefix else ""
    parser.add_argument("input", type=Path, metavar="INPUT",
                        help=f"{INPUT}; or what stabilize wrote, whose homographies are then taken as they are")
    parser.add_argument("output", type=Path, metavar="OUT.mcap", help="the bag to write")
    parser.add_argument("--image-topic", metavar="T", help="which images, where a bag has several topics of them")
    parser.add_argument("--config", type=Path, metavar="FILE.yaml",
                        help=f"a ROS parameter file with parameters of the {node}")
    parser.add_argument("-p", dest="parameters", type=assignment, action="append", default=[], metavar="name:=value",
                        help=f"a parameter of the {node}, else of the tracker, where it runs on the fly{both}; may be "
                        "repeated, and overrides --config")
    parser.add_argument("--gcps", type=Path, metavar="GCPS.csv", help="ground control points: the parameter gcps_file")
    parser.add_argument("--camera", type=Path, metavar="camera.yaml",
                        help="calibration and pose of the camera: the parameter camera_file")
    parser.add_argument("--telemetry", type=Path, metavar="BAG",
                        help="recording of the sensors, where they are not in INPUT, as telemetry writes it")


def add_reading(parser: argparse.ArgumentParser) -> None:
    """How much of INPUT is read, by which time, and --force."""
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames")
    parser.add_argument("--fps", type=positive_float, metavar="F",
                        help="frame rate of a video or folder (default: the file's, else 25)")
    add_time(parser)
    add_force(parser)


def values_of(options: argparse.Namespace, node: str, table: Table, tracker_prefix: str = "") -> tuple[Any, Any]:
    """The parameters of a node, and those of the tracker, as the options of `add_inputs` give them.

    Args:
        options: parsed.
        node: as a parameter file names it.
        table: of its parameters.
        tracker_prefix: as of `add_inputs`.

    Raises:
        InputError: a name is unknown, or a value is wrong.
    """
    from stab_ros.parameters.file import read_config
    from stab_ros.parameters.table import PARAMETERS, checked_values

    given = dict(options.parameters)
    of_tracker = {name: given.pop(name) for name in list(given)
                  if (tracker_prefix and name.startswith(tracker_prefix)) or (name in PARAMETERS and name not in table)}
    values = read_config(options.config, node) if options.config else {}
    files = {"gcps_file": options.gcps, "camera_file": options.camera}
    given |= {name: str(path) for name, path in files.items() if path is not None}
    return values | checked_values(given, table), checked_values(
        {name.removeprefix(tracker_prefix): value for name, value in of_tracker.items()})
