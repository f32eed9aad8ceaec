"""`stab-ros compare`: methods side by side over the same frames."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stab_ros.cli.console import DONE, progress_bar, quiet_libraries, tell, tell_made, warn
from stab_ros.cli.options import INPUT, add_force, add_time, assignment, command, names, positive_float, positive_int
from stab_ros.core.errors import InputError

if TYPE_CHECKING:
    from stab_ros.jobs.compare import ComparisonJob
    from stab_ros.jobs.result_outputs import ResultOutputs


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "compare", "run methods and presets over the same frames, and judge them side by side")
    parser.add_argument("input", type=Path, metavar="INPUT", help=INPUT)
    parser.add_argument("--methods", type=names, metavar="a,b,...", help="methods and presets (default: all)")
    parser.add_argument("--truth", type=Path, metavar="H.csv",
                        help="the true homographies, frame by frame: tells the error of each method")
    parser.add_argument("--json", type=Path, metavar="J.json", help="write all figures as JSON")
    parser.add_argument("--csv", type=Path, metavar="M.csv", help="write a table with a row for each frame and method")
    parser.add_argument("--report", type=Path, metavar="DIR", help="write a report to look at, DIR/index.html")
    parser.add_argument("--points", type=Path, metavar="P.csv",
                        help="verification points in reference px, as name,x,y (default: chosen in the reference)")
    parser.add_argument("--study", choices=("models", "estimators"),
                        help="instead: the table of transformation models or of estimators of Zhang et al. 2023")
    parser.add_argument("--image-topic", metavar="T", help="which images, where a bag has several topics of them")
    parser.add_argument("--config", type=Path, metavar="FILE.yaml",
                        help="a ROS parameter file with parameters of the tracker")
    parser.add_argument("-p", dest="parameters", type=assignment, action="append", default=[], metavar="name:=value",
                        help="a parameter of all trackers, or of the evaluator; may be repeated, overrides --config")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames")
    parser.add_argument("--fps", type=positive_float, metavar="F", help="frame rate of a video or folder")
    add_time(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.picture import Clock
    from stab_ros.jobs.compare import ComparisonJob, checked_methods, shared_values
    from stab_ros.jobs.compare_study import study_method
    from stab_ros.jobs.result_outputs import ResultOutputs
    from stab_ros.parameters.file import read_config

    methods = (study_method(options.methods),) if options.study else checked_methods(options.methods)
    given, parameters = read_config(options.config) if options.config else {}, dict(options.parameters)
    if "method" in parameters:
        raise InputError("-p method: a comparison is over several, name them with --methods a,b")
    values, judging = shared_values({**given, **parameters})
    judging |= {"points_file": str(options.points)} if options.points else {}
    job = ComparisonJob(options.input, methods, values, judging, options.truth, options.image_topic, options.limit,
                        options.fps, Clock(options.time))
    outputs = ResultOutputs(options.json, options.csv, options.report)
    outputs.check(job.source, options.force)
    if options.study:
        return _study(options.study, job, outputs)
    return _compare_methods(job, outputs)


def _compare_methods(job: ComparisonJob, outputs: ResultOutputs) -> int:
    from stab_ros.jobs.compare import compare
    from stab_ros.jobs.compare_outputs import writers_of
    from stab_ros.jobs.compare_text import as_text
    from stab_ros.jobs.compiling import compile_shown

    with quiet_libraries(), progress_bar("frames") as progress:
        comparison = compare(job, progress, compile_shown)
    warn(comparison.warnings)
    tell(as_text(comparison))
    with quiet_libraries(), progress_bar("frames") as progress:
        made = outputs.write(writers_of(comparison, job, progress))
    tell_made(made)
    return DONE


def _study(kind: str, job: ComparisonJob, outputs: ResultOutputs) -> int:
    from stab_ros.jobs.compare_study import check_outputs, run_study, study_text, write_study
    from stab_ros.jobs.compiling import compile_shown

    check_outputs(job, outputs)
    with quiet_libraries(), progress_bar("frames") as progress:
        study = run_study(kind, job, progress, compile_shown)
    warn(study.warnings)
    tell(study_text(study))
    if outputs.json is not None:
        write_study(study, outputs.json)
        tell_made({"json": outputs.json})
    return DONE
