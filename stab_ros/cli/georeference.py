"""`stab-ros georeference`: a recording into orthophotos on the water plane."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, progress_bar, quiet_libraries, tell, warn
from stab_ros.cli.options import command, positive_float
from stab_ros.cli.placing_options import add_inputs, add_reading, values_of
from stab_ros.core.text import counted


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "georeference", "map a recording to orthophotos of the water plane, in metres")
    add_inputs(parser, "georeference_node")
    parser.add_argument("--homographies", type=Path, metavar="H.csv",
                        help="write a table of the homographies from undistorted pixels to metres in the map")
    parser.add_argument("--geotiff", type=Path, metavar="DIR",
                        help="write the first and the last placed frame of each interval as GeoTIFF")
    parser.add_argument("--interval", type=positive_float, metavar="S",
                        help="length of the intervals of --geotiff in seconds (default: one for the whole recording)")
    parser.add_argument("--no-image", action="store_true", help="leave image_ortho out of the bag")
    add_reading(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.picture import Clock
    from stab_ros.jobs.compiling import compile_shown
    from stab_ros.jobs.georeference import Job, georeference
    from stab_ros.parameters.file import GEOREFERENCE
    from stab_ros.parameters.table import GEOREFERENCE_PARAMETERS

    values, tracker_values = values_of(options, GEOREFERENCE, GEOREFERENCE_PARAMETERS)
    job = Job(
        options.input, options.output, values, tracker_values, image_topic=options.image_topic,
        telemetry=options.telemetry, limit=options.limit, fps=options.fps, clock=Clock(options.time),
        homographies=options.homographies, geotiff=options.geotiff, interval_s=options.interval,
        with_image=not options.no_image, force=options.force)
    with quiet_libraries(), progress_bar("frames") as progress:
        result = georeference(job, progress, compile_shown)
    warn(result.warnings)
    tell(f"{counted(result.frames, 'frame')}: {result.placed} placed, {result.unplaced.total()} unplaced, "
         f"{result.frames / result.duration_s:.1f} frames/s")
    for reason, count in result.unplaced.most_common():
        tell(f"unplaced {count} of {result.frames}: {reason}")
    if result.grid_size is not None:
        width, height = result.grid_size
        tell(f"orthophoto:   {width}x{height} px of {result.resolution_m:.4g} m")
    for name, value in result.values.items():
        tell(f"{name + ':':13} {value:.4g}")
    for name, path in (("bag", job.output), ("homographies", job.homographies)):
        if path is not None:
            tell(f"{name + ':':13} {path}")
    if job.geotiff is not None:
        tell(f"GeoTIFFs:     {result.geotiffs} in {job.geotiff}")
    return DONE
