"""`stab-ros georeference`: a recording into orthophotos on the water plane."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, progress_bar, quiet_libraries, tell, warn
from stab_ros.cli.options import INPUT, add_force, add_time, assignment, command, positive_float, positive_int


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "georeference", "map a recording to orthophotos of the water plane, in metres")
    parser.add_argument("input", type=Path, metavar="INPUT",
                        help=f"{INPUT}; or what stabilize wrote, whose homographies are then taken as they are")
    parser.add_argument("output", type=Path, metavar="OUT.mcap", help="the bag to write")
    parser.add_argument("--image-topic", metavar="T", help="which images, where a bag has several topics of them")
    parser.add_argument("--config", type=Path, metavar="FILE.yaml",
                        help="a ROS parameter file with parameters of the georeference_node")
    parser.add_argument("-p", dest="parameters", type=assignment, action="append", default=[], metavar="name:=value",
                        help="a parameter of the georeference_node, else of the tracker, where it runs on the fly; may "
                        "be repeated, and overrides --config")
    parser.add_argument("--gcps", type=Path, metavar="GCPS.csv", help="ground control points: the parameter gcps_file")
    parser.add_argument("--camera", type=Path, metavar="camera.yaml",
                        help="calibration and pose of the camera: the parameter camera_file")
    parser.add_argument("--telemetry", type=Path, metavar="BAG",
                        help="recording of the sensors, where they are not in INPUT, as telemetry writes it")
    parser.add_argument("--homographies", type=Path, metavar="H.csv",
                        help="write a table of the homographies from undistorted pixels to metres in the map")
    parser.add_argument("--geotiff", type=Path, metavar="DIR",
                        help="write the first and the last placed frame of each interval as GeoTIFF")
    parser.add_argument("--interval", type=positive_float, metavar="S",
                        help="length of the intervals of --geotiff in seconds (default: one for the whole recording)")
    parser.add_argument("--no-image", action="store_true", help="leave image_ortho out of the bag")
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
    from stab_ros.jobs.georeference import Job, georeference

    values, tracker_values = _values(options)
    job = Job(
        options.input, options.output, values, tracker_values, image_topic=options.image_topic,
        telemetry=options.telemetry, limit=options.limit, fps=options.fps, clock=Clock(options.time),
        homographies=options.homographies, geotiff=options.geotiff, interval_s=options.interval,
        with_image=not options.no_image, force=options.force)
    with quiet_libraries(), progress_bar("frames") as progress:
        result = georeference(job, progress, compile_shown)
    warn(result.warnings)
    tell(f"{result.frames} frames: {result.placed} placed, {result.unplaced.total()} unplaced, "
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


def _values(options: argparse.Namespace) -> tuple[Any, Any]:
    """The parameters of georeferencing, and those of the tracker."""
    from stab_ros.parameters.file import GEOREFERENCE, read_config
    from stab_ros.parameters.table import GEOREFERENCE_PARAMETERS, PARAMETERS, checked_values

    given = dict(options.parameters)
    of_tracker = {name: given.pop(name) for name in list(given)
                  if name in PARAMETERS and name not in GEOREFERENCE_PARAMETERS}
    values = read_config(options.config, GEOREFERENCE) if options.config else {}
    files = {"gcps_file": options.gcps, "camera_file": options.camera}
    given |= {name: str(path) for name, path in files.items() if path is not None}
    return values | checked_values(given, GEOREFERENCE_PARAMETERS), checked_values(of_tracker)
