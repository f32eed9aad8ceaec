"""The latched messages of a recording that a replay from a later time on begins with, as `ros2 bag play` does."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from stab_ros.io.bag import Message
from stab_ros.nodes.cdr_publisher import CdrPublisher


class LatchedMessages:
    """The last messages of each latched topic, as many as its publisher keeps for late subscribers."""

    def __init__(self, outputs: Mapping[str, CdrPublisher]) -> None:
        """outputs: the publishers, by topic."""
        self._last = {topic: deque[Message](maxlen=output.depth)
                      for topic, output in outputs.items() if output.is_latched}

    def take(self, message: Message) -> None:
        """A message from before the start."""
        if message.topic in self._last:
            self._last[message.topic].append(message)

    def release(self) -> list[Message]:
        """What was kept, in the order of the log; once."""
        kept = [message for messages in self._last.values() for message in messages]
        self._last.clear()
        return sorted(kept, key=lambda message: message.log_time_ns)
