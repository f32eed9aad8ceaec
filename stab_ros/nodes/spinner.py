"""Runs the callbacks of a node one at a time, and measures the free time between them."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException

from stab_ros.io.cdr import SECOND_NS
from stab_ros.nodes.free_time import FreeTime
from stab_ros.nodes.stopping import StopRequest

_STEP_S = 0.1  # a wait is no longer, so that a stop request is noticed
_SETTLED_NS, _LONG_NS = 3 * SECOND_NS // 10, SECOND_NS  # of free time


class Spinner:
    """Lets the `work` of a node be a plain loop. free: is told of every wait. failed: of what escapes a callback."""

    def __init__(self, executor: SingleThreadedExecutor, stop: StopRequest, free: FreeTime,
                 failed: Callable[[BaseException], None]) -> None:
        self._executor = executor
        self._stop = stop
        self._free = free
        self._failed = failed

    @property
    def stopping(self) -> bool:
        return self._stop.requested

    def once(self, timeout_s: float = _STEP_S) -> None:
        """Runs one callback, waiting for it at most `timeout_s`."""
        most_ns, before_ns = round(min(timeout_s, _STEP_S) * SECOND_NS), time.monotonic_ns()
        try:
            callback, _, _ = self._executor.wait_for_ready_callbacks(most_ns / SECOND_NS)
        except (TimeoutException, ShutdownException):
            callback = None
        self._free.waited(time.monotonic_ns() - before_ns, most_ns)
        if callback is not None:
            callback()
            failure = callback.exception()
            if failure is not None:
                self._failed(failure)

    def drain(self, progress: Callable[[], int]) -> None:
        """Runs callbacks until the queues seem empty.

        That is after 0.3 s of free time without a change of `progress`, or 1 s of free time altogether.
        """
        before, start_ns, changed_ns = progress(), self._free.ns, self._free.ns
        while self._free.ns - changed_ns < _SETTLED_NS and self._free.ns - start_ns < _LONG_NS:
            self.once()
            if progress() != before:
                before, changed_ns = progress(), self._free.ns
