"""Replays bags/sample.mcap through the live nodes and shows the result: `python -m stab_ros.demo [FOLDER] [--rate R]`.

Exit codes: 0 all promises hold, 1 a promise does not hold or a node failed, 2 the sample is missing or the usage is
wrong, 130 interrupted.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from stab_ros.cli.options import Parser, positive_float
from stab_ros.core.errors import InputError, StabRosError, WorkError
from stab_ros.core.text import one_line
from stab_ros.demo.replay import Replay, replay
from stab_ros.demo.stages import stage
from stab_ros.demo.verdict import DemoResult, Files, reach
from stab_ros.demo.water import read_water
from stab_ros.io.homographies import read_homographies
from stab_ros.jobs.compiling import compile_all

SAMPLE = Path(__file__).resolve().parents[2] / "bags" / "sample.mcap"
TRUTH, WATER = SAMPLE.with_name("sample_truth.csv"), SAMPLE.with_name("sample_water.csv")
GSD_M, SIZE = 0.06, (960, 540)  # of the sample: m a pixel, width and height
SCALE = {"gsd_m": GSD_M}
DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the demo and returns its exit code."""
    parser = Parser(prog="python -m stab_ros.demo", description="Shows the main job at work.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("demo_output"), help="where the results go")
    parser.add_argument("--rate", type=positive_float, default=1.0, metavar="R",
                        help="how fast the flight is played, times real time (default: 1); changes no result")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C, so that the nodes end as well
    try:
        return _tell(run(options.folder, options.rate))
    except StabRosError as error:
        _say(str(error))
        return BAD_INPUT if isinstance(error, InputError) else FAILED
    except OSError as error:
        _say(f"{error.filename}: {error.strerror}")
        return FAILED
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED


def run(folder: Path, rate: float) -> DemoResult:
    """Runs all stages, with all outputs in `folder`.

    Raises:
        InputError: the sample is unreadable, or the rate cannot be played. WorkError: a node failed and left no bag.
    """
    truth, water, files = read_homographies(TRUTH), read_water(WATER, GSD_M, SIZE), Files(folder)
    job = Replay(SAMPLE, len(truth), files.bag, files.log, rate, SCALE)
    folder.mkdir(parents=True, exist_ok=True)
    files.remove()
    with stage("compile", "the inner loops, once after an installation or a change") as current:
        current.outcome = _compile()
    with stage("replay", f"{SAMPLE.name} through player, tracker, evaluator and recorder, {rate:g} times real "
               f"time") as current:
        current.outcome, broken = _replay(job)
    if broken and not files.bag.exists():
        raise WorkError(broken)
    with stage("judge", "the answers beside the truth and the command's; makes video and report, and measures the "
               "water") as current:
        verdict = reach(SAMPLE, truth, water, files, SCALE, broken)
        current.outcome = f"{sum(not check.failure for check in verdict.checks)} of {len(verdict.checks)} promises hold"
    return verdict


def _compile() -> str:
    """Compiles before the nodes start, each of which would otherwise do it."""
    done = compile_all()
    return f"{done.total} kernels, {done.compiled} of them new"


def _replay(job: Replay) -> tuple[str, str]:
    """The outcome, and why the replay failed, else ""; the recording is evaluated in either case."""
    try:
        return f"{replay(job)} of {job.frames} frames answered and measured", ""
    except WorkError as error:
        return "broke off", str(error)


def _tell(verdict: DemoResult) -> int:
    print(f"\n{verdict.text()}\n", flush=True)
    for failure in verdict.failures:
        _say(failure)
    print(verdict.what_to_open(), flush=True)
    return FAILED if verdict.failures else DONE


def _say(line: str) -> None:
    print("demo:", one_line(line), file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
