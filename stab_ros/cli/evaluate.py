"""`stab-ros evaluate`: the residual motion of a stabilised recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stab_ros.cli.console import DONE, progress_bar, quiet_libraries, tell, tell_made, warn
from stab_ros.cli.options import INPUT, add_force, add_time, assignment, command, positive_float, positive_int


def add(commands: Any) -> None:
    """The parser of this command."""
    parser = command(commands, "evaluate", "measure how still a stabilised recording stands")
    parser.add_argument("bag", type=Path, metavar="BAG", help=INPUT)
    parser.add_argument("--points", type=Path, metavar="P.csv",
                        help="verification points in reference px, as name,x,y (default: chosen in the reference)")
    parser.add_argument("--json", type=Path, metavar="J.json", help="write all figures as JSON")
    parser.add_argument("--csv", type=Path, metavar="M.csv", help="write a table with a row for each frame")
    parser.add_argument("--report", type=Path, metavar="DIR", help="write a report to look at, DIR/index.html")
    parser.add_argument("--image-topic", dest="image_topics", action="append", default=[], metavar="T",
                        help="which images, where a bag holds more than a raw and a stabilised stream; may be repeated")
    parser.add_argument("--config", type=Path, metavar="FILE.yaml",
                        help="a ROS parameter file with parameters of the evaluator")
    parser.add_argument("-p", dest="parameters", type=assignment, action="append", default=[], metavar="name:=value",
                        help="a parameter of the evaluator; may be repeated, and overrides --config")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames")
    parser.add_argument("--fps", type=positive_float, metavar="F", help="frame rate of a video or folder, and for "
                        "velocities (default: the file's or the stamps')")
    add_time(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs the command and returns its exit code."""
    from stab_ros.io.picture import Clock
    from stab_ros.jobs.compiling import compile_shown
    from stab_ros.jobs.evaluate import EvaluationJob, evaluate
    from stab_ros.jobs.evaluate_outputs import writers_of
    from stab_ros.jobs.evaluate_text import as_text
    from stab_ros.jobs.result_outputs import ResultOutputs
    from stab_ros.parameters.file import EVALUATOR, read_config
    from stab_ros.parameters.table import EVALUATOR_PARAMETERS, checked_values

    values = read_config(options.config, EVALUATOR) if options.config else {}
    values |= checked_values(dict(options.parameters), EVALUATOR_PARAMETERS)
    values |= {"points_file": str(options.points)} if options.points else {}
    job = EvaluationJob(options.bag, values, tuple(options.image_topics), options.limit, options.fps,
                        Clock(options.time))
    outputs = ResultOutputs(options.json, options.csv, options.report)
    outputs.check(job.source, options.force)
    with quiet_libraries(), progress_bar("frames") as progress:
        evaluation = evaluate(job, progress, compile_shown)
    warn(evaluation.warnings)
    tell(as_text(evaluation))
    with quiet_libraries(), progress_bar("frames") as progress:
        made = outputs.write(writers_of(evaluation, job, progress))
    tell_made(made)
    return DONE
