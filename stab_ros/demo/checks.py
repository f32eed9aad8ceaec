"""The promises of the demo, whether they hold, and advice where they do not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from stab_ros.demo.command import Apart
from stab_ros.demo.flow import RUNS_M_S, Flow
from stab_ros.demo.judgement import Judgement
from stab_ros.demo.result import Answers, ReplayResult

# The promise of the README, and five times as much for a single frame: 3 mm on the ground of the sample, which is
# negligible in velocimetry. The error of a wrongly registered frame is much larger.
_ERROR_95_PX, _ERROR_MAX_PX = 0.01, 0.05
_SAME = 1e-9  # of homographies and of metrics: messages round them once more
_STILL_M_S = 0.001  # of the bank
_SPEED_SHARE = 0.03  # of the known median speed
_RUNS = 5  # number of runs of frames that a sentence lists


@dataclass(frozen=True)
class Check:
    """A promise and its result. failure: a sentence; empty if the promise holds."""

    promise: str
    found: str
    failure: str = ""

    def text(self) -> str:
        """One line of text."""
        return f"{'NO ' if self.failure else 'yes'}  {self.promise:<64}{self.found}"


def checks(result: ReplayResult, answers: Answers, command: Apart, folder: Path) -> Iterator[Check]:
    """The promises of the tracker."""
    log = folder / "log"
    yield _answered(result, log)
    yield _tracked(result, log)
    yield from _errors(result, folder)
    yield _pictures(result, log)
    yield _as_command(answers, command, folder)


def judging_check(judgement: Judgement, log: Path) -> Check:
    """The promise of the evaluator."""
    failure, apart = "", judgement.live_difference
    if judgement.unmeasured:
        failure = (f"{frames_text(judgement.unmeasured)} got no measures from the live evaluator; "
                   f"{log / 'evaluator_node.txt'} may say why")
    elif not apart <= _SAME:
        failure = (f"the measures of the live evaluator differ from those of `stab-ros evaluate` by {apart:g}; "
                   f"it may have missed pictures or the reference, {log / 'evaluator_node.txt'} says what it refused")
    return Check(f"live measures are those of `stab-ros evaluate`, to {_SAME:g}", f"{apart:g} apart", failure)


def flow_checks(flow: Flow, page: Path) -> Iterator[Check]:
    """The promises of velocimetry and discharge."""
    yield _bank(flow, page)
    yield _speed(flow, page)
    yield _discharge(flow)


def _bank(flow: Flow, page: Path) -> Check:
    failure = (f"the bank should move by at most {_STILL_M_S:g} m/s, it moves by {flow.bank_m_s:.4f} m/s by "
               f"{flow.bank.count} vectors: either the frames do not lie still, or there is no static map; "
               f"see {page}")
    return Check(f"the bank stands still, to {1000 * _STILL_M_S:g} mm/s", f"{1000 * flow.bank_m_s:.2f} mm/s",
                 "" if flow.bank_m_s <= _STILL_M_S else failure)


def _speed(flow: Flow, page: Path) -> Check:
    speed, true = flow.medians_m_s
    failure = (f"the median speed of the {flow.runs.sum()} vectors should be {true:.3f} m/s within "
               f"{_SPEED_SHARE:.0%}, it is {speed:.3f} m/s; see where in {page}")
    return Check(f"median speed is the water's to {_SPEED_SHARE:.0%}, where it runs at {RUNS_M_S:g} m/s",
                 f"{speed / true - 1:+.1%}", "" if abs(speed / true - 1) <= _SPEED_SHARE else failure)


def _discharge(flow: Flow) -> Check:
    found, true_m3_s = flow.discharge, flow.true_m3_s
    failure = (f"the discharge should have the true {true_m3_s:.2f} m3/s in its interval, which is "
               f"{found.low_m3_s:.2f} to {found.high_m3_s:.2f} m3/s, {found.shares.measured:.0%} of it measured")
    return Check("the 95 % interval of the discharge holds the truth", f"{found.q_m3_s / true_m3_s - 1:+.1%}",
                 "" if found.low_m3_s <= true_m3_s <= found.high_m3_s else failure)


def _answered(result: ReplayResult, log: Path) -> Check:
    failure = (f"{frames_text(result.unanswered)} got no answer: the tracker sent no homography for them, or it did "
               f"not arrive; {log / 'tracker_node.txt'} and {log / 'bag_recorder_node.txt'} may say why")
    return Check("every frame is answered with its homography", f"{result.answered} of {result.frames}",
                 failure if result.unanswered else "")


def _tracked(result: ReplayResult, log: Path) -> Check:
    failure = (f"{frames_text(result.lost)} could not be tracked: the ground of the first frame was not found "
               f"there; {log / 'tracker_node.txt'} may say why, `make test` shows whether the methods work here")
    return Check("every frame is tracked", f"{result.tracked} of {result.frames}", failure if result.lost else "")


def _errors(result: ReplayResult, folder: Path) -> Iterator[Check]:
    """The errors against the truth; none without frames to compare, which other checks report."""
    if not len(result.error_px):
        return
    share, worst = float(np.percentile(result.error_px, 95)), int(np.argmax(result.error_px))
    beyond = [frame for frame, error_px in zip(result.compared, result.error_px, strict=True)
              if error_px > _ERROR_MAX_PX]
    too_wide = (f"95 % of the frames should lie within {_ERROR_95_PX:g} px of the truth, they lie within {share:.3f} "
                f"px; {folder / 'H.csv'} holds the homographies, `make test` shows whether the methods work here")
    too_far = (f"{frames_text(beyond)} should lie within {_ERROR_MAX_PX:g} px of the truth, but "
               f"frame {result.compared[worst]} is {result.error_px[worst]:.3f} px off; see there in "
               f"{folder / 'before_after.mp4'} and {folder / 'H.csv'}, the frames are numbered from 0")
    yield Check(f"95 % of the frames lie within {_ERROR_95_PX:g} px of the truth", f"{share:.3f} px",
                "" if share <= _ERROR_95_PX else too_wide)
    yield Check(f"all frames lie within {_ERROR_MAX_PX:g} px of the truth", f"{result.error_px[worst]:.3f} px",
                too_far if beyond else "")


def _pictures(result: ReplayResult, log: Path) -> Check:
    failure = (f"{frames_text(result.without_picture)} came out without a picture, though tracked and after the "
               f"start; {log / 'tracker_node.txt'} and {log / 'bag_recorder_node.txt'} may say why")
    expected, missing = len(result.at_once), len(result.without_picture)
    return Check(f"every frame has a picture, but the {len(result.late)} of the start",
                 f"{expected - missing} of {expected}", failure if missing else "")


def _as_command(answers: Answers, command: Apart, folder: Path) -> Check:
    provisional = [values for values in answers.tracks.values() if values.get("provisional") == "true"]
    why = (f" ({len(provisional)} frames were answered before enough was seen to tell what is ground, as if the "
           "pictures had stopped coming)") if provisional else ""
    failure = (f"the live homographies should be those of `stab-ros stabilize`, but differ by {command.largest:g} in "
               f"frame {command.frame}{why}; compare {folder / 'H.csv'} with {folder / 'H_command.csv'}")
    return Check(f"live homographies are those of `stab-ros stabilize`, to {_SAME:g}", f"{command.largest:g} apart",
                 "" if command.largest <= _SAME else failure)


def frames_text(frames: Sequence[int]) -> str:
    """Ascending frame numbers as text: `frame 3`, `frames 3 to 5 and 9`."""
    runs = [[frame for _, frame in run] for _, run in groupby(enumerate(frames), lambda pair: pair[1] - pair[0])]
    named = [f"{run[0]}" if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs[:_RUNS]]
    more = sum(len(run) for run in runs[_RUNS:])
    parts = [*named, f"{more} more"] if more else named
    listed = " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)
    return f"frame {listed}" if len(frames) == 1 else f"frames {listed}"
