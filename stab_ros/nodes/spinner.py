"""Runs the callbacks of a node one at a time, and measures the free time between them.

One group of them does not wait for its turn: a thread beside runs it (`receptionist.py`). The other services, which
change the node, wait for the callback that runs, but not for those that wait too.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.service import Service

from stab_ros.io.cdr import SECOND_NS
from stab_ros.nodes.free_time import FreeTime
from stab_ros.nodes.part_executor import PartExecutor
from stab_ros.nodes.receptionist import Receptionist
from stab_ros.nodes.stopping import StopRequest

_STEP_S = 0.1  # a wait is no longer, so that a stop request is noticed
_SETTLED_NS, _LONG_NS = 3 * SECOND_NS // 10, SECOND_NS  # of free time
_SLOW_NS = SECOND_NS // 50  # a callback that takes longer may have kept somebody waiting


class Spinner:
    """Lets the `work` of a node be a plain loop. To be closed before the node is destroyed.

    at_once: the group of callbacks that run beside. free: is told of every wait. failed: of what escapes a callback.
    """

    def __init__(self, node: Node, at_once: CallbackGroup, stop: StopRequest, free: FreeTime,
                 failed: Callable[[BaseException], None]) -> None:
        self._node, self._stop, self._free, self._failed = node, stop, free, failed
        self._executor = PartExecutor(lambda entity: entity.callback_group is not at_once)
        self._executor.add_node(node)
        self._changes = PartExecutor(
            lambda entity: isinstance(entity, Service) and entity.callback_group is not at_once)
        self._receptionist = Receptionist(node, at_once)
        self._was_slow = False

    def close(self) -> None:
        """Ends the thread."""
        self._receptionist.close()
        self._changes.shutdown()
        self._executor.shutdown()

    @property
    def stopping(self) -> bool:
        return self._stop.requested

    def once(self, timeout_s: float = _STEP_S) -> None:
        """Runs one callback, waiting for it at most `timeout_s`."""
        self._tell_failures()
        if self._was_slow:
            self._make_changes()
        most_ns, before_ns = round(min(timeout_s, _STEP_S) * SECOND_NS), time.monotonic_ns()
        callback = self._executor.next_callback(most_ns / SECOND_NS)
        begun_ns = time.monotonic_ns()
        self._free.waited(begun_ns - before_ns, most_ns)
        if callback is not None:
            callback()
            self._was_slow = time.monotonic_ns() - begun_ns > _SLOW_NS
            failure = callback.exception()
            if failure is not None:
                self._failed(failure)

    def _make_changes(self) -> None:
        """What was asked for during a slow callback, before the next one: it would be another slow one in a backlog."""
        self._was_slow, there_are = False, True
        while there_are and not self.stopping:
            there_are, failure = self._changes.run_one(self._node, 0.0)
            if failure is not None:
                self._failed(failure)

    def _tell_failures(self) -> None:
        while self._receptionist.failures:
            self._failed(self._receptionist.failures.popleft())

    def drain(self, progress: Callable[[], int]) -> None:
        """Runs callbacks until the queues seem empty.

        That is after 0.3 s of free time without a change of `progress`, or 1 s of free time altogether.
        """
        before, start_ns, changed_ns = progress(), self._free.ns, self._free.ns
        while self._free.ns - changed_ns < _SETTLED_NS and self._free.ns - start_ns < _LONG_NS:
            self.once()
            if progress() != before:
                before, changed_ns = progress(), self._free.ns
