"""Replays bags/sample.mcap through the live nodes and shows the result: `python -m stab_ros.demo [FOLDER]`.

Exit codes: 0 done, 1 frames were lost or a node failed, 2 the sample is not there, 130 interrupted.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from stab_ros.core.errors import InputError, StabRosError, WorkError
from stab_ros.demo.judgement import judge
from stab_ros.demo.pictures import show
from stab_ros.demo.replay import replay
from stab_ros.demo.result import Result, compare, read_answers, write_table
from stab_ros.io.homographies import read_homographies

SAMPLE = Path(__file__).resolve().parents[2] / "bags" / "sample.mcap"
TRUTH = SAMPLE.with_name("sample_truth.csv")
SCALE = {"gsd_m": 0.06}  # of the sample, m a pixel
DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the demo and gives its exit code."""
    parser = argparse.ArgumentParser(prog="python -m stab_ros.demo", description="Shows the main job at work.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("demo_output"), help="where the results go")
    folder = parser.parse_args(arguments).folder
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: the nodes must not outlive us
    try:
        print(run(folder))
    except StabRosError as error:
        print(f"demo: {error}", file=sys.stderr)
        return BAD_INPUT if isinstance(error, InputError) else FAILED
    except OSError as error:
        print(f"demo: {error.filename}: {error.strerror}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("demo: interrupted", file=sys.stderr)
        return INTERRUPTED
    return DONE


def run(folder: Path) -> str:
    """Everything, into `folder`; what to tell about it.

    Raises:
        InputError: the sample cannot be read. WorkError: a node failed, or frames were lost.
    """
    truth = read_homographies(TRUTH)
    bag, table, errors = folder / "stabilized.mcap", folder / "H.csv", folder / "errors.txt"
    folder.mkdir(parents=True, exist_ok=True)
    replay(SAMPLE, bag, folder / "log", len(truth), SCALE)
    answers = read_answers(bag)
    write_table(table, truth, answers)
    result = compare(truth, answers)
    errors.write_text(result.text() + "\n", encoding="utf-8")
    check_complete(result, folder)
    video, picture = show(SAMPLE, bag, folder)
    judgement = judge(bag, folder / "report", SCALE)
    made = {"stabilised bag": bag, "homographies": table, "errors": errors, "video": video, "picture": picture,
            "report": judgement.report}
    return "\n".join([result.text(), "", judgement.text(), "",
                      *(f"{what:<16}{path}" for what, path in made.items())])


def check_complete(result: Result, folder: Path) -> None:
    """Raises WorkError if a frame was not answered, was lost, or its picture is missing."""
    complete = result.frames == result.answered == result.tracked
    if not complete or result.images != result.frames - result.deferred:
        raise WorkError(f"of {result.frames} frames {result.answered} were answered, {result.tracked} tracked and "
                        f"{result.images} came out as pictures, it must be all of them, and pictures of all but the "
                        f"{result.deferred} that were answered late; see {folder / 'log'}")


if __name__ == "__main__":
    sys.exit(main())
