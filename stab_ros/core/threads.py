"""The number of threads of this process; results do not depend on it."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import cv2

_MAX_DEFAULT_THREADS = 4  # with more, the time per frame is limited by memory bandwidth


class _ThreadPool:
    """Worker threads that help the calling thread; created when first needed."""

    def __init__(self) -> None:
        self.threads = 1
        self._helpers: ThreadPoolExecutor | None = None
        self.resize(0)

    def resize(self, count: int) -> None:
        threads = count or min(available(), _MAX_DEFAULT_THREADS)
        cv2.setNumThreads(threads)
        if threads != self.threads:
            self.threads, self._helpers = threads, None  # the old ones finish their work

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
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_POOL = _ThreadPool()


def use_threads(count: int) -> None:
    """Sets the number of threads of the whole process, including OpenCV; 0: one per core, but at most four."""
    _POOL.resize(count)


def in_parallel(work: Callable[[int, int], None], count: int, least: int) -> None:
    """Calls `work(first, last)` in parallel for equal parts of range(count), each at least `least` long.

    To be faster than one call, `work` must release the GIL. The parts must write to separate memory.
    """
    _POOL.share(work, count, least)
