"""`stab-ros camera`: the fit of a camera to ground control points."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, quiet_libraries, tell, tell_made, warn
from stab_ros.cli.options import add_force, command, positive_float
from stab_ros.core.errors import InputError


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "camera", "fit a camera to ground control points: pose, focal length, lens")
    parser.add_argument("gcps", type=Path, metavar="GCPS",
                        help="a .csv name,x,y,X,Y,Z (pixels, then metres) or with lat and lon, a table of KLT-IV, or a "
                        ".geojson")
    parser.add_argument("--image", type=Path, required=True, metavar="FRAME",
                        help="the picture in which the points were marked, or a recording of that size")
    parser.add_argument("-o", "--output", type=Path, metavar="CAMERA.yaml",
                        help="write calibration, pose and covariance")
    parser.add_argument("--camera", metavar="INFO.yaml",
                        help="a known camera: a calibration file, or the name of a profile, as dji_phantom_4_pro, "
                        "whose focal length is fitted if the points tell it")
    parser.add_argument("--k1", action="store_true", help="fit the first lens coefficient too")
    parser.add_argument("--two-focals", action="store_true", help="fit fx and fy apart")
    parser.add_argument("--plane", action="store_true",
                        help="fit the homography to the water plane only, from points on it")
    parser.add_argument("--position", type=place, metavar="X,Y,Z",
                        help="where the camera is, as the file writes places (for lat and lon: latitude, longitude, "
                        "height)")
    parser.add_argument("--position-sigma", type=not_negative, default=0.0, metavar="M",
                        help="its standard deviation, m (default 0: it is kept as given)")
    parser.add_argument("--crs", metavar="EPSG:nnnn",
                        help="the reference system of the places (default: local metres; WGS 84 for lat and lon, "
                             "beside which a projected one is that of orthophotos)")
    parser.add_argument("--wse", type=number, metavar="M",
                        help="water surface elevation, in the heights of the points")
    parser.add_argument("--height", type=positive_float, metavar="M",
                        help="known height of the camera above the water, to check the scale")
    parser.add_argument("--distance", type=distance, metavar="A,B,M",
                        help="known distance of two control points, to check the scale")
    parser.add_argument("--sigma-px", type=positive_float, metavar="PX",
                        help="standard deviation of marked pixels (default: the residuals tell it)")
    parser.add_argument("--sigma-m", type=not_negative, default=0.0, metavar="M",
                        help="standard deviation of surveyed places")
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    import numpy as np

    from stab_ros.georeferencing.point_noise import PointNoise
    from stab_ros.io.camera_file import write_camera_file
    from stab_ros.io.outputs import check_output
    from stab_ros.jobs.camera import CameraJob, fit_from_files
    from stab_ros.jobs.camera_text import as_text

    if options.output is not None and options.plane:
        raise InputError("-o with --plane: a homography is no camera; leave out one of both")
    position = None if options.position is None else np.array(options.position)
    job = CameraJob(options.gcps, options.image, options.camera, 2 if options.two_focals else 1, options.k1,
                    options.plane, position, options.position_sigma, options.crs, options.wse, options.height,
                    options.distance, PointNoise(options.sigma_px, options.sigma_m))
    with quiet_libraries():
        fitted = fit_from_files(job)
    if options.output is not None:
        check_output(options.output, ".yaml", options.gcps, options.force)
    warn(fitted.warnings)
    tell(as_text(fitted))
    if options.output is not None and fitted.file is not None:
        write_camera_file(options.output, fitted.file)
        tell_made({"camera": options.output})
    return DONE


def number(text: str) -> float:
    """For argparse: a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} must be a number")
    return value


def not_negative(text: str) -> float:
    """For argparse: a finite number, 0 or above."""
    if number(text) < 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number, 0 or above")
    return number(text)


def place(text: str) -> tuple[float, float, float]:
    """For argparse: three numbers between commas."""
    cells = text.split(",")
    if len(cells) != 3:
        raise argparse.ArgumentTypeError(f"{text!r} must be three numbers between commas, as in 12.5,-30,46.2")
    x, y, z = (number(cell) for cell in cells)
    return x, y, z


def distance(text: str) -> tuple[str, str, float]:
    """For argparse: two names and a distance between commas."""
    cells = [cell.strip() for cell in text.split(",")]
    if len(cells) != 3 or not cells[0] or not cells[1]:
        raise argparse.ArgumentTypeError(f"{text!r} must be two points and metres between commas, as in G1,G2,34.6")
    return cells[0], cells[1], positive_float(cells[2])
