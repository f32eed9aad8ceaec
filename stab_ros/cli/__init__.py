"""The command `stab-ros`: parses, calls `io` (or `nodes`), and turns errors into one line and an exit code.

Exit codes: 0 done, 1 work broke off, 2 bad input or usage, 130 interrupted. A command imports what it needs when it
runs, so that usage errors and --help are quick and only `play` and `record` need ROS.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stab_ros import __version__
from stab_ros.cli.options import Parser, assignment, names, positive_float, positive_int, seconds
from stab_ros.core.errors import InputError, StabRosError
from stab_ros.core.memory import keep_freed_memory
from stab_ros.core.text import one_line

if TYPE_CHECKING:
    from stab_ros.jobs.compare import ComparisonJob
    from stab_ros.jobs.result_outputs import ResultOutputs

DONE, BROKEN_OFF, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
_STDERR = 2
_BAG = "an .mcap, a rosbag2 folder or a ROS 1 .bag"
_INPUT = "an .mcap, a rosbag2 folder, a ROS 1 .bag, a video or a folder of images"
_PLAY_OPTIONS = ("rate", "loop", "start_offset", "clock", "wait_for_subscribers")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and gives its exit code; every error that is not a bug ends here."""
    options = _parser().parse_args(arguments)
    keep_freed_memory()
    run: Callable[[argparse.Namespace], int] = options.run
    try:
        code = run(options)
        sys.stdout.flush()
        return code
    except StabRosError as error:
        _say(str(error))
        return BAD_INPUT if isinstance(error, InputError) else BROKEN_OFF
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is left to do is to end
        _say("interrupted; an unfinished output has .partial in its name")
        return INTERRUPTED
    except BrokenPipeError:  # who reads our output has gone, as in `stab-ros info BAG | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_OFF


def _parser() -> Parser:
    parser = Parser(prog="stab-ros", description="Holds a river still: registers drone video to one reference frame.")
    parser.add_argument("--version", action="version", version=f"stab-ros {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_stabilize(commands)
    _add_evaluate(commands)
    _add_compare(commands)
    _add_convert(commands)
    _add_play(commands)
    _add_record(commands)
    _add_recover(commands)
    _add_info(commands)
    _add_warm_up(commands)
    return parser


def _command(commands: Any, name: str, does: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=does, description=f"{does[0].upper()}{does[1:]}.")
    return parser


def _add_stabilize(commands: Any) -> None:
    parser = _command(commands, "stabilize", "stabilise a recording into an MCAP bag")
    parser.add_argument("input", type=Path, metavar="INPUT", help=_INPUT)
    parser.add_argument("output", type=Path, metavar="OUTPUT.mcap", help="the bag to write")
    parser.add_argument("--image-topic", metavar="T", help="which images, where a bag has several topics of them")
    parser.add_argument("--config", type=Path, metavar="FILE.yaml",
                        help="a ROS parameter file with parameters of the tracker")
    parser.add_argument("-p", dest="parameters", type=assignment, action="append", default=[], metavar="name:=value",
                        help="a parameter of the tracker; may be repeated, and overrides --config")
    parser.add_argument("--homographies", type=Path, metavar="H.csv", help="write a table of all homographies")
    parser.add_argument("--video", type=Path, metavar="V.mp4",
                        help="write the stabilised frames as a video, in which a lost frame repeats the one before")
    parser.add_argument("--no-image", action="store_true", help="leave image_stabilized out of the bag")
    parser.add_argument("--keep-raw", action="store_true", help="take the raw images over into the bag")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames")
    parser.add_argument("--fps", type=positive_float, metavar="F",
                        help="frame rate of a video or folder (default: the file's, else 25), and of --video")
    _add_force(parser)
    parser.set_defaults(run=_stabilize)


def _stabilize(options: argparse.Namespace) -> int:
    from stab_ros.jobs.compiling import compile_shown
    from stab_ros.jobs.stabilize import Job, stabilize
    from stab_ros.parameters.engines import read_config
    from stab_ros.parameters.table import checked_values

    values = read_config(options.config) if options.config else {}
    values |= checked_values(dict(options.parameters))
    job = Job(options.input, options.output, values, options.image_topic, options.homographies, options.video,
              not options.no_image, options.keep_raw, options.limit, options.fps, options.force)
    with _quiet_libraries(), _progress("frames") as progress:
        summary = stabilize(job, progress, compile_shown)
    _warn(summary.warnings)
    print(f"{summary.frames} frames: {summary.tracked} tracked, {summary.lost} lost, "
          f"{summary.frames / summary.duration_s:.1f} frames/s")
    for name, path in (("bag", job.output), ("homographies", job.homographies), ("video", job.video)):
        if path is not None:
            print(f"{name + ':':13} {path}")
    return DONE


def _add_evaluate(commands: Any) -> None:
    parser = _command(commands, "evaluate", "measure how still a stabilised recording stands")
    parser.add_argument("bag", type=Path, metavar="BAG", help=_INPUT)
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
    _add_force(parser)
    parser.set_defaults(run=_evaluate)


def _evaluate(options: argparse.Namespace) -> int:
    from stab_ros.jobs.compiling import compile_shown
    from stab_ros.jobs.evaluate import EvaluationJob, evaluate
    from stab_ros.jobs.evaluate_outputs import writers_of
    from stab_ros.jobs.evaluate_text import as_text
    from stab_ros.jobs.result_outputs import ResultOutputs
    from stab_ros.parameters.engines import EVALUATOR, read_config
    from stab_ros.parameters.table import EVALUATOR_PARAMETERS, checked_values

    values = read_config(options.config, EVALUATOR) if options.config else {}
    values |= checked_values(dict(options.parameters), EVALUATOR_PARAMETERS)
    values |= {"points_file": str(options.points)} if options.points else {}
    job = EvaluationJob(options.bag, values, tuple(options.image_topics), options.limit, options.fps)
    outputs = ResultOutputs(options.json, options.csv, options.report)
    outputs.check(job.source, options.force)
    with _quiet_libraries(), _progress("frames") as progress:
        evaluation = evaluate(job, progress, compile_shown)
    _warn(evaluation.warnings)
    print(as_text(evaluation))
    with _quiet_libraries(), _progress("frames") as progress:
        made = outputs.write(writers_of(evaluation, job, progress))
    _tell_made(made)
    return DONE


def _add_compare(commands: Any) -> None:
    parser = _command(commands, "compare", "run methods and presets over the same frames, and judge them side by side")
    parser.add_argument("input", type=Path, metavar="INPUT", help=_INPUT)
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
    _add_force(parser)
    parser.set_defaults(run=_compare)


def _compare(options: argparse.Namespace) -> int:
    from stab_ros.jobs.compare import ComparisonJob, checked_methods, shared_values
    from stab_ros.jobs.compare_study import study_method
    from stab_ros.jobs.result_outputs import ResultOutputs
    from stab_ros.parameters.engines import read_config

    methods = (study_method(options.methods),) if options.study else checked_methods(options.methods)
    given, parameters = read_config(options.config) if options.config else {}, dict(options.parameters)
    if "method" in parameters:
        raise InputError("-p method: a comparison is over several, name them with --methods a,b")
    values, judging = shared_values({**given, **parameters})
    judging |= {"points_file": str(options.points)} if options.points else {}
    job = ComparisonJob(options.input, methods, values, judging, options.truth, options.image_topic, options.limit,
                        options.fps)
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

    with _quiet_libraries(), _progress("frames") as progress:
        comparison = compare(job, progress, compile_shown)
    _warn(comparison.warnings)
    print(as_text(comparison))
    with _quiet_libraries(), _progress("frames") as progress:
        made = outputs.write(writers_of(comparison, job, progress))
    _tell_made(made)
    return DONE


def _study(kind: str, job: ComparisonJob, outputs: ResultOutputs) -> int:
    from stab_ros.jobs.compare_study import check_outputs, run_study, study_text, write_study
    from stab_ros.jobs.compiling import compile_shown

    check_outputs(job, outputs)
    with _quiet_libraries(), _progress("frames") as progress:
        study = run_study(kind, job, progress, compile_shown)
    _warn(study.warnings)
    print(study_text(study))
    if outputs.json is not None:
        write_study(study, outputs.json)
        _tell_made({"json": outputs.json})
    return DONE


def _add_convert(commands: Any) -> None:
    parser = _command(commands, "convert", "turn any recording into an MCAP bag")
    parser.add_argument("input", type=Path, metavar="INPUT", help=_INPUT)
    parser.add_argument("output", type=Path, metavar="OUTPUT.mcap", help="the bag to write")
    parser.add_argument("--topic", metavar="T", help="for a video or folder: the topic of the images (default "
                        "/camera/image_raw); for a bag: the one topic to convert (default: all)")
    parser.add_argument("--fps", type=positive_float, metavar="F", help="frame rate of a video or folder")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="stop after N frames of a video or folder")
    _add_force(parser)
    parser.set_defaults(run=_convert)


def _convert(options: argparse.Namespace) -> int:
    from stab_ros.jobs.convert import Conversion, convert

    job = Conversion(options.input, options.output, options.topic, options.fps, options.limit, options.force)
    with _quiet_libraries(), _progress("messages") as progress:
        done = convert(job, progress)
    _warn(done.warnings)
    print(f"{done.messages} messages\nbag: {job.output}")
    return DONE


def _add_play(commands: Any) -> None:
    parser = _command(commands, "play", "publish a bag's messages live (needs ROS 2)")
    parser.add_argument("bag", type=Path, metavar="BAG", help=_BAG)
    parser.add_argument("--rate", type=positive_float, metavar="R", help="times real time (default: 1)")
    parser.add_argument("--loop", action="store_true", default=None, help="start again at the end")
    parser.add_argument("--start-offset", type=seconds, metavar="S", help="skip the first S seconds")
    parser.add_argument("--clock", action="store_true", default=None, help="publish /clock")
    parser.add_argument("--wait-for-subscribers", type=positive_int, metavar="N",
                        help="begin once the image topics (without any: all topics) have N subscribers in total")
    parser.set_defaults(run=_play)


def _play(options: argparse.Namespace) -> int:
    given = {name: value for name, value in vars(options).items() if name in _PLAY_OPTIONS and value is not None}
    with _needs_ros("play"):
        from stab_ros.nodes.bag_player import play

        return play({"bag": str(options.bag), **given})


def _add_record(commands: Any) -> None:
    parser = _command(commands, "record", "record live topics into an MCAP bag (needs ROS 2)")
    parser.add_argument("output", type=Path, metavar="OUT.mcap", help="the bag to write; Ctrl-C ends it")
    parser.add_argument("topics", nargs="+", metavar="TOPIC", help="of any installed type")
    _add_force(parser)
    parser.set_defaults(run=_record)


def _record(options: argparse.Namespace) -> int:
    with _needs_ros("record"):
        from stab_ros.nodes.bag_recorder import record

        return record({"output": str(options.output), "topics": options.topics, "overwrite": options.force})


def _add_recover(commands: Any) -> None:
    parser = _command(commands, "recover", "save what can be read of a broken .mcap")
    parser.add_argument("broken", type=Path, metavar="BROKEN.mcap", help="what a crash or a full disk left")
    parser.add_argument("fixed", type=Path, metavar="FIXED.mcap", help="the bag to write")
    _add_force(parser)
    parser.set_defaults(run=_recover)


def _recover(options: argparse.Namespace) -> int:
    from stab_ros.io.outputs import check_output
    from stab_ros.jobs.recover import recover

    check_output(options.fixed, ".mcap", options.broken, options.force)
    saved = recover(options.broken, options.fixed, options.force)
    _warn(saved.warnings)
    print(f"{saved.messages} messages on {saved.topics} topics\nbag: {options.fixed}")
    return DONE


def _add_info(commands: Any) -> None:
    parser = _command(commands, "info", "show what a recording holds")
    parser.add_argument("bag", type=Path, metavar="BAG", help=_INPUT)
    parser.set_defaults(run=_info)


def _info(options: argparse.Namespace) -> int:
    from stab_ros.jobs.info import describe

    with _quiet_libraries():
        lines, warnings = describe(options.bag)
    _warn(warnings)
    print("\n".join(lines))
    return DONE


def _add_warm_up(commands: Any) -> None:
    parser = _command(commands, "warm-up", "compile what nodes and commands need, so that their first start is quick")
    parser.set_defaults(run=_warm_up)


def _warm_up(_options: argparse.Namespace) -> int:
    from stab_ros.jobs.compiling import warm_up

    print(warm_up())
    return DONE


def _add_force(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--force", action="store_true", help="overwrite output that exists")


def _say(line: str) -> None:
    print("stab-ros:", one_line(line), file=sys.stderr)


def _tell_made(made: Mapping[str, Path]) -> None:
    for name, path in made.items():
        print(f"{name + ':':8} {path}")


def _warn(warnings: Iterable[str]) -> None:
    for warning in warnings:
        _say(f"warning: {warning}")


@contextmanager
def _needs_ros(command: str) -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(f"{command} needs ROS 2, but there is no module {error.name}; install ROS 2 Jazzy or "
                         "`pip install ros-jazzy-rclpy[fastrtps] ros-jazzy-common-interfaces`") from error


@contextmanager
def _progress(unit: str) -> Iterator[Callable[[int, int | None], None]]:
    """Shows how many are done, a second's rate and the time left, from the first one on; only on a terminal."""
    from stab_ros.jobs.progress_bar import make_bar

    with ExitStack() as bars:
        bar = None

        def show(done: int, total: int | None) -> None:
            nonlocal bar
            bar = bar or bars.enter_context(make_bar(unit, total=total))
            bar.total = total
            bar.update(done - bar.n)

        yield show


@contextmanager
def _quiet_libraries() -> Iterator[None]:
    """`sys.stderr` goes on, descriptor 2 leads nowhere: libjpeg, libpng and FFmpeg write to it as they please."""
    with os.fdopen(os.dup(_STDERR), "w", buffering=1, errors="backslashreplace") as ours, redirect_stderr(ours):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, _STDERR)
        os.close(nowhere)
        try:
            yield
        finally:
            os.dup2(ours.fileno(), _STDERR)
