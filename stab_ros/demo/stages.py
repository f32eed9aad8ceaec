"""The progress of the demo: a line at the start of each stage, and one with its time at the end.

Progress bars in between are shown on a terminal only and removed, so a log file has the same lines.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from stab_ros.jobs.progress_bar import make_bar


@dataclass
class StageReport:
    """The end of a stage. outcome: its result, as text."""

    outcome: str = "done"


@contextmanager
def stage(name: str, doing: str) -> Iterator[StageReport]:
    """Prints the start of a stage, and its outcome unless an error ends it."""
    started_s = time.monotonic()
    _say(name, f"{doing} ...")
    current = StageReport()
    yield current
    _say(name, f"{current.outcome}  {time.monotonic() - started_s:.1f} s")


@contextmanager
def bar(what: str) -> Iterator[Callable[[int, int | None], None]]:
    """A progress bar of frames."""
    with make_bar("frames", desc=what) as shown:

        def show(done: int, total: int | None) -> None:
            shown.total = total
            shown.update(done - shown.n)

        yield show


def _say(name: str, text: str) -> None:
    print(f"{name:<10}{text}", flush=True)
