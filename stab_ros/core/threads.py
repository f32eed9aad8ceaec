"""How many threads this process computes with; no result depends on it."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import cv2

_MOST = 4  # unless more are asked for: what a frame takes is bound by memory from there on


class _Crew:
    """The threads that help the one which asks, made when they are first needed."""

    def __init__(self) -> None:
        self.threads = 1
        self._helpers: ThreadPoolExecutor | None = None
        self.resize(0)

    def resize(self, count: int) -> None:
        threads = count or min(available(), _MOST)
        cv2.setNumThreads(threads)
        if threads != self.threads:
            self.threads, self._helpers = threads, None  # what the old ones have begun they finish

    def share(self, work: Callable[[int, int], None], count: int, least: int) -> None:
        parts = max(1, min(self.threads, count // least))
        first, *rest = pairwise(count * part // parts for part in range(parts + 1))
        if rest and self._helpers is None:
            self._helpers = ThreadPoolExecutor(self.threads - 1, "stab_ros")
        others = [self._helpers.submit(work, *span) for span in rest] if self._helpers else []
        work(*first)
        for other in others:
            other.result()


def available() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_CREW = _Crew()


def use_threads(count: int) -> None:
    """From now on, in all of this process, OpenCV included; 0: one for each core, but at most four."""
    _CREW.resize(count)


def in_parallel(work: Callable[[int, int], None], count: int, least: int) -> None:
    """Calls `work(first, last)` for even parts of range(count), each at least `least` long, side by side.

    What `work` calls must let go of the GIL to gain by it, and write to places of its own.
    """
    _CREW.share(work, count, least)
