"""`stab-ros velocity`: surface velocities of a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stab_ros.cli.console import DONE, progress_bar, quiet_libraries, tell, warn
from stab_ros.cli.options import command
from stab_ros.cli.placing_options import add_inputs, add_reading, values_of
from stab_ros.core.text import counted

if TYPE_CHECKING:
    from stab_ros.jobs.velocity import Velocities

_OF_TRACKER = "tracker."  # before a parameter of the tracker whose name velocimetry has too


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "velocity", "measure surface velocities, each with its standard deviation")
    add_inputs(parser, "velocimetry_node", _OF_TRACKER)
    parser.add_argument("--csv", type=Path, metavar="V.csv", help="write a table of the vectors")
    parser.add_argument("--tracks", type=Path, metavar="T.geojson", help="write the vectors as lines, for a GIS")
    parser.add_argument("--netcdf", type=Path, metavar="V.nc", help="write the vectors as NetCDF, by CF conventions")
    parser.add_argument("--netcdf-grid", type=Path, metavar="G.nc",
                        help="write velocity_grid of all intervals as NetCDF, by CF conventions")
    parser.add_argument("--html", type=Path, metavar="V.html", help="write a report page, one file")
    add_reading(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.picture import Clock
    from stab_ros.jobs.compiling import compile_shown
    from stab_ros.jobs.velocity import Job, velocity
    from stab_ros.parameters.file import VELOCIMETRY
    from stab_ros.parameters.table import VELOCITY_PARAMETERS
    from stab_ros.parameters.velocimeters import georeference_values

    values, tracker_values = values_of(options, VELOCIMETRY, VELOCITY_PARAMETERS, _OF_TRACKER)
    job = Job(
        options.input, options.output, georeference_values(values), tracker_values, image_topic=options.image_topic,
        telemetry=options.telemetry, limit=options.limit, fps=options.fps, clock=Clock(options.time),
        velocity_values=values, csv=options.csv, tracks=options.tracks, netcdf=options.netcdf,
        netcdf_grid=options.netcdf_grid, html=options.html, force=options.force)
    with quiet_libraries(), progress_bar("frames") as progress:
        result = velocity(job, progress, compile_shown)
    warn(result.warnings)
    _tell(result)
    for name, path in (("bag", job.output), ("vectors", job.csv), ("tracks", job.tracks), ("NetCDF", job.netcdf),
                       ("grid", job.netcdf_grid), ("report", job.html)):
        if path is not None:
            tell(f"{name + ':':13} {path}")
    return DONE


def _tell(result: Velocities) -> None:
    from stab_ros.velocimetry.bank_over_time import told
    from stab_ros.velocimetry.dropped import dropped_text

    unplaced = result.unplaced.total()
    tell(f"{counted(result.frames, 'frame')}: {result.frames - unplaced} placed, {unplaced} unplaced, "
         f"{result.frames / result.duration_s:.1f} frames/s")
    for reason, count in result.unplaced.most_common():
        tell(f"unplaced {count} of {result.frames}: {reason}")
    tell(f"vectors:      {len(result.vectors)} in {counted(result.intervals, 'interval')}")
    if result.dropped:
        tell(f"dropped:      {dropped_text(result.dropped)}")
    if len(result.vectors):
        tell(f"median speed: {result.median_speed:.4g} {result.unit}/s")
    if result.bank.count:
        tell(f"bank:         {told(result.bank, result.unit)}")
