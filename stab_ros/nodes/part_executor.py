"""An executor for some of a node's callbacks, beside the one that runs the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException


class PartExecutor(SingleThreadedExecutor):
    """chosen: which of the entities (subscriptions, timers, services, ...) are its own; asked before every wait."""

    def __init__(self, chosen: Callable[[Any], bool]) -> None:
        super().__init__()
        self._chosen = chosen

    def can_execute(self, entity: Any) -> bool:
        """As rclpy asks it of every entity before it waits."""
        return self._chosen(entity) and bool(super().can_execute(entity))

    def run_one(self, node: Any, timeout_s: float) -> tuple[bool, BaseException | None]:
        """Runs one callback of `node`, which belongs to another executor; waits at most `timeout_s` for it.

        Returns:
            Whether there was one, and the exception that escaped it.
        """
        try:
            callback, _, _ = self.wait_for_ready_callbacks(timeout_s, [node])
        except (TimeoutException, ShutdownException):
            return False, None
        callback()
        return True, callback.exception()
