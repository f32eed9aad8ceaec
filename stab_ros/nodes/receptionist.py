"""Answers what needs no waiting for the work of a node, on a thread of its own."""

from __future__ import annotations

from collections import deque
from threading import Thread

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from stab_ros.nodes.part_executor import PartExecutor

_STEP_S = 0.1  # a wait is no longer, so that services that come later are noticed, and `close`


class Receptionist:
    """Runs the callbacks of one group of a node until `close`.

    Attributes:
        failures: what has escaped them, for the main thread to judge.
    """

    def __init__(self, node: Node, group: CallbackGroup) -> None:
        self.failures: deque[BaseException] = deque()
        self._node, self._closed = node, False
        self._executor = PartExecutor(lambda entity: entity.callback_group is group)
        self._thread = Thread(target=self._run, name="receptionist", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Waits for the callback that runs; to be called before the node is destroyed."""
        self._closed = True
        self._thread.join()
        self._executor.shutdown()

    def _run(self) -> None:
        while not self._closed:
            _, failure = self._executor.run_one(self._node, _STEP_S)
            if failure is not None and not isinstance(failure, InvalidHandle):  # of a service that is gone meanwhile
                self.failures.append(failure)
