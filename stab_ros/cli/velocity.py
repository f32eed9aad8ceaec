"""`stab-ros velocity`: surface velocities of a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stab_ros.cli.console import DONE, progress_bar, quiet_libraries, tell, warn
from stab_ros.cli.options import INPUT, add_force, add_time, assignment, command, positive_float, positive_int

if TYPE_CHECKING:
    from stab_ros.jobs.velocity import Velocities

_OF_TRACKER = "tracker."  # before a parameter of the tracker whose name velocimetry has too


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "velocity", "measure surface velocities, each with its standard deviation")
    parser.add_argument("input", type=Path, metavar="INPUT",
                        help=f"{INPUT}; or what stabilize wrote, whose homographies are then taken as they are")
    parser.add_argument("output", type=Path, metavar="OUT.mcap", help="the bag to write")
    parser.add_argument("--image-topic", metavar="T", help="which images, where a bag has several topics of them")
    parser.add_argument("--config", type=Path, metavar="FILE.yaml",
                        help="a ROS parameter file with parameters of the velocimetry_node")
    parser.add_argument("-p", dest="parameters", type=assignment, action="append", default=[], metavar="name:=value",
                        help="a parameter of the velocimetry_node, else of the tracker, where it runs on the fly "
                        "(tracker.name:=value where both have the name); may be repeated, and overrides --config")
    parser.add_argument("--gcps", type=Path, metavar="GCPS.csv", help="ground control points: the parameter gcps_file")
    parser.add_argument("--camera", type=Path, metavar="camera.yaml",
                        help="calibration and pose of the camera: the parameter camera_file")
    parser.add_argument("--telemetry", type=Path, metavar="BAG",
                        help="recording of the sensors, where they are not in INPUT, as telemetry writes it")
    parser.add_argument("--csv", type=Path, metavar="V.csv", help="write a table of the vectors")
    parser.add_argument("--tracks", type=Path, metavar="T.geojson", help="write the vectors as lines, for a GIS")
    parser.add_argument("--netcdf", type=Path, metavar="V.nc", help="write the vectors as NetCDF, by CF conventions")
    parser.add_argument("--html", type=Path, metavar="V.html", help="write a report page, one file")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames")
    parser.add_argument("--fps", type=positive_float, metavar="F",
                        help="frame rate of a video or folder (default: the file's, else 25)")
    add_time(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.picture import Clock
    from stab_ros.jobs.compiling import compile_shown
    from stab_ros.jobs.velocity import Job, velocity
    from stab_ros.parameters.velocimeters import georeference_values

    values, tracker_values = _values(options)
    job = Job(
        options.input, options.output, georeference_values(values), tracker_values, image_topic=options.image_topic,
        telemetry=options.telemetry, limit=options.limit, fps=options.fps, clock=Clock(options.time),
        velocity_values=values, csv=options.csv, tracks=options.tracks, netcdf=options.netcdf, html=options.html,
        force=options.force)
    with quiet_libraries(), progress_bar("frames") as progress:
        result = velocity(job, progress, compile_shown)
    warn(result.warnings)
    _tell(result)
    for name, path in (("bag", job.output), ("vectors", job.csv), ("tracks", job.tracks), ("NetCDF", job.netcdf),
                       ("report", job.html)):
        if path is not None:
            tell(f"{name + ':':13} {path}")
    return DONE


def _tell(result: Velocities) -> None:
    from stab_ros.velocimetry.bank_over_time import told

    unplaced = result.unplaced.total()
    tell(f"{result.frames} frames: {result.frames - unplaced} placed, {unplaced} unplaced, "
         f"{result.frames / result.duration_s:.1f} frames/s")
    for reason, count in result.unplaced.most_common():
        tell(f"unplaced {count} of {result.frames}: {reason}")
    tell(f"vectors:      {len(result.vectors)} in {result.intervals} intervals")
    if len(result.vectors):
        tell(f"median speed: {result.median_speed:.4g} {result.unit}/s")
    if result.bank.count:
        tell(f"bank:         {told(result.bank, result.unit)}")


def _values(options: argparse.Namespace) -> tuple[Any, Any]:
    """The parameters of velocimetry, and those of the tracker."""
    from stab_ros.parameters.file import VELOCIMETRY, read_config
    from stab_ros.parameters.table import PARAMETERS, VELOCITY_PARAMETERS, checked_values

    given = dict(options.parameters)
    of_tracker = {name: given.pop(name) for name in list(given)
                  if name.startswith(_OF_TRACKER) or (name in PARAMETERS and name not in VELOCITY_PARAMETERS)}
    values = read_config(options.config, VELOCIMETRY) if options.config else {}
    files = {"gcps_file": options.gcps, "camera_file": options.camera}
    given |= {name: str(path) for name, path in files.items() if path is not None}
    return values | checked_values(given, VELOCITY_PARAMETERS), checked_values(
        {name.removeprefix(_OF_TRACKER): value for name, value in of_tracker.items()})
