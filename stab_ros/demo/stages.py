"""What the demo says while it works: a line as each stage begins, and one when it is over, with its time.

Bars come in between, on a terminal only, and are wiped again; so a log file reads as the terminal does.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from stab_ros.jobs.progress_bar import make_bar


@dataclass
class StageReport:
    """outcome: what came of it, once that is known."""

    outcome: str = "done"


@contextmanager
def stage(name: str, doing: str) -> Iterator[StageReport]:
    """Tells that a stage begins, and how it ends unless an error ends it."""
    started_s = time.monotonic()
    _say(name, f"{doing} ...")
    current = StageReport()
    yield current
    _say(name, f"{current.outcome}  {time.monotonic() - started_s:.1f} s")


@contextmanager
def bar(what: str) -> Iterator[Callable[[int, int | None], None]]:
    """Shows how many frames are done, and of how many."""
    with make_bar("frames", desc=what) as shown:

        def show(done: int, total: int | None) -> None:
            shown.total = total
            shown.update(done - shown.n)

        yield show


def _say(name: str, text: str) -> None:
    print(f"{name:<10}{text}", flush=True)
