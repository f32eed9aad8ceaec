"""An executor for some of a node's callbacks, beside the one that runs the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node


class PartExecutor(SingleThreadedExecutor):
    """chosen: which of the entities (subscriptions, timers, services, ...) are its own; asked before every wait."""

    def __init__(self, chosen: Callable[[Any], bool]) -> None:
        super().__init__()
        self._chosen = chosen

    def can_execute(self, entity: Any) -> bool:
        """As rclpy asks it of every entity before it waits."""
        return self._chosen(entity) and bool(super().can_execute(entity))

    def next_callback(self, timeout_s: float, nodes: Sequence[Node] | None = None) -> Any:
        """A task that is ready to be called, and tells afterwards what escaped it; None: none was within `timeout_s`.

        nodes: those to look at; None: all that were added.
        """
        try:
            return self.wait_for_ready_callbacks(timeout_s, nodes)[0]
        except (TimeoutException, ShutdownException):
            return None

    def run_one(self, node: Node, timeout_s: float) -> tuple[bool, BaseException | None]:
        """Runs one callback of `node`, which belongs to another executor; waits at most `timeout_s` for it.

        Returns:
            Whether there was one, and the exception that escaped it.
        """
        callback = self.next_callback(timeout_s, [node])
        if callback is None:
            return False, None
        callback()
        return True, callback.exception()
