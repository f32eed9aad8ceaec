"""`stab-ros discharge`: the discharge through a cross-section, with its uncertainty."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, note, quiet_libraries, tell, tell_made, warn
from stab_ros.cli.options import (
    add_force,
    command,
    finite,
    nonnegative_float,
    nonnegative_int,
    positive_float,
    positive_int,
)
from stab_ros.core.errors import InputError

_SETTINGS = ("search_m", "verticals", "min_vectors", "integration", "filling", "alpha", "alpha_sigma", "wse_sigma_m",
             "depth_sigma_m", "filling_sigma", "draws", "seed")


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "discharge", "measure discharge from velocities and a cross-section")
    parser.add_argument("velocity", type=Path, nargs="?", metavar="VELOCITY",
                        help="a recording with velocities, or the V.csv that velocity wrote")
    parser.add_argument("section", type=Path, nargs="?", metavar="SECTION.csv",
                        help="the cross-section: X,Y,Z or X,Y,depth in the map, or chainage,Z or chainage,depth")
    _add_place(parser)
    _add_method(parser)
    parser.add_argument("--rating", type=Path, metavar="R.csv",
                        help="table of gaugings: this one is added, and a rating curve fitted to all; without VELOCITY "
                        "and SECTION, only fitted")
    parser.add_argument("--stage", type=finite, metavar="M", help="stage at the gauge for --rating (default: --wse)")
    parser.add_argument("--no-flow", dest="h0_m", type=finite, metavar="M",
                        help="stage of no flow, h0, where it is known (default: fitted)")
    parser.add_argument("--json", type=Path, metavar="Q.json", help="write all figures as JSON")
    parser.add_argument("--csv", type=Path, metavar="Q.csv", help="write a table with a row for each vertical")
    parser.add_argument("--html", "--report", dest="report", type=Path, metavar="DIR",
                        help="write a page to look at, DIR/index.html")
    add_force(parser)
    parser.set_defaults(run=run)


def _add_place(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--topic", metavar="T", help="of the velocities, where a recording has several")
    parser.add_argument("--wse", dest="wse_m", type=finite, metavar="M",
                        help="water surface elevation in the heights of the section (default: as recorded)")
    parser.add_argument("--wse-sigma", dest="wse_sigma_m", type=nonnegative_float, metavar="M",
                        help="its standard deviation (default 0.02)")
    parser.add_argument("--from", dest="start", type=pair, metavar="X,Y", help="where a section by chainage starts")
    parser.add_argument("--to", dest="end", type=pair, metavar="X,Y", help="where it ends, or any place in its line")
    parser.add_argument("--from-chainage", type=finite, metavar="M",
                        help="chainage at --from (default 0)")
    parser.add_argument("--crs", metavar="EPSG:nnnn", help="reference system of the section's places and of --from and "
                        "--to (default: the metres of the map)")
    parser.add_argument("--origin", type=pair, metavar="LAT,LON",
                        help="origin of the map, for --crs, where the recording does not tell it")
    heights = parser.add_mutually_exclusive_group()
    heights.add_argument("--elevation", dest="heights", action="store_const", const="elevation",
                         help="the heights of the section are elevations of the bed")
    heights.add_argument("--depth", dest="heights", action="store_const", const="depth", help="they are depths")


def _add_method(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--search", dest="search_m", type=nonnegative_float, metavar="M",
                        help="search distance around each vertical (default 0: half the distance of verticals)")
    parser.add_argument("--verticals", type=nonnegative_int, metavar="N",
                        help="evenly spaced verticals (default 0: the points of the section)")
    parser.add_argument("--min-vectors", type=positive_int, metavar="N",
                        help="vectors from which a vertical counts as measured (default 3)")
    parser.add_argument("--filling", metavar="F",
                        help="for verticals without vectors: kriging (default), froude, froude_linear, klt_iv, "
                        "quadratic or cubic")
    parser.add_argument("--integration", metavar="I", help="mid_section (default) or mean_section")
    parser.add_argument("--alpha", type=positive_float, metavar="A",
                        help="depth-averaged over surface velocity (default 0.85)")
    parser.add_argument("--alpha-sigma", type=nonnegative_float, metavar="A",
                        help="its standard deviation (default 0.04)")
    parser.add_argument("--depth-sigma", dest="depth_sigma_m", type=nonnegative_float, metavar="M",
                        help="standard deviation of each bed point (default 0.02)")
    parser.add_argument("--filling-sigma", type=nonnegative_float, metavar="R",
                        help="relative standard deviation of filled velocities one width away (default 0.3)")
    parser.add_argument("--draws", type=positive_int, metavar="N", help="Monte Carlo draws (default 1000)")
    parser.add_argument("--seed", type=nonnegative_int, metavar="N", help="their seed (default 0)")


def pair(text: str) -> tuple[float, float]:
    """For argparse: two numbers between commas."""
    cells = text.split(",")
    if len(cells) != 2:
        raise argparse.ArgumentTypeError(f"{text!r} must be two numbers between commas, as in 12.5,-30")
    return finite(cells[0]), finite(cells[1])


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    if options.velocity is None and options.rating is not None:
        return _only_rating(options)
    if options.velocity is None or options.section is None:
        raise InputError("VELOCITY and SECTION.csv are missing; only --rating alone works without them")
    from stab_ros.jobs.discharge import discharge_from_files
    from stab_ros.jobs.discharge_outputs import writers_of
    from stab_ros.jobs.discharge_text import as_text
    from stab_ros.jobs.result_outputs import ResultOutputs

    outputs = ResultOutputs(options.json, options.csv, options.report)
    outputs.check(options.velocity, options.force)
    with quiet_libraries():
        measured = discharge_from_files(_job(options))
    warn(measured.warnings)
    tell(as_text(measured))
    rating = None
    if options.rating is not None:
        rating = _joined_rating(options, measured)
    with quiet_libraries():
        made = outputs.write(writers_of(measured, rating))
    tell_made(made)
    return DONE


def _job(options: argparse.Namespace) -> Any:
    from stab_ros.discharge.settings import DischargeConfig
    from stab_ros.georeferencing.local_frame import LocalFrame
    from stab_ros.jobs.discharge import DischargeJob
    from stab_ros.jobs.discharge_input import Line

    given = {name: getattr(options, name) for name in _SETTINGS if getattr(options, name) is not None}
    if (options.start is None) != (options.end is None):
        raise InputError("--from and --to belong together; give both or none")
    if options.start is None and options.from_chainage is not None:
        raise InputError("--from-chainage is the chainage at --from; give --from and --to, too")
    line = None if options.start is None else Line(options.start, options.end, options.from_chainage or 0.0)
    origin = None if options.origin is None else LocalFrame(options.origin[0], options.origin[1], 0.0)
    return DischargeJob(options.velocity, options.section, DischargeConfig(**given), options.wse_m, line,
                        options.heights, options.crs, origin, options.topic)


def _joined_rating(options: argparse.Namespace, measured: Any) -> Any:
    """Adds the discharge to the table of gaugings and fits the curve."""
    from stab_ros.io.gauging_file import read_gaugings
    from stab_ros.jobs.rating import gauging_of, joined_by, rating_of

    known = read_gaugings(options.rating) if options.rating.exists() else ()
    table = joined_by(known, gauging_of(measured, options.stage))
    rating = rating_of(table.gaugings, options.h0_m)
    _tell_rating(rating)
    note(f"{options.rating}: {one}" for one in table.replaced)
    warn(f"{options.rating}: {one}" for one in table.doubts)
    _write_gaugings(options.rating, table.gaugings)
    return rating


def _only_rating(options: argparse.Namespace) -> int:
    from stab_ros.io.gauging_file import read_gaugings
    from stab_ros.jobs.rating import rating_of
    from stab_ros.jobs.rating_outputs import rating_writers
    from stab_ros.jobs.result_outputs import ResultOutputs

    outputs = ResultOutputs(options.json, options.csv, options.report)
    outputs.check(options.rating, options.force)
    rating = rating_of(read_gaugings(options.rating), options.h0_m)
    if isinstance(rating, str):
        raise InputError(f"{options.rating}: {rating}")
    _tell_rating(rating)
    with quiet_libraries():
        made = outputs.write(rating_writers(rating))
    tell_made(made)
    return DONE


def _tell_rating(rating: Any) -> None:
    from stab_ros.jobs.discharge_text import rating_text

    warn(() if isinstance(rating, str) else rating.warnings)
    tell("", rating_text(rating))


def _write_gaugings(path: Path, gaugings: Any) -> None:
    from stab_ros.io.gauging_file import write_gaugings
    from stab_ros.io.outputs import completed

    with completed(path) as partial:
        write_gaugings(gaugings, partial)
    tell_made({"rating": path})
