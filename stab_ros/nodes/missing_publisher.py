"""That nobody publishes what a node needs, and what becomes of its work, said once."""

from __future__ import annotations

from rclpy.impl.rcutils_logger import RcutilsLogger

_LOOKS = 50  # in vain until it is said: 5 s


class MissingPublisher:
    """Of one topic; `look` is to be called ten times a second."""

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._in_vain = 0  # looks since somebody published it
        self._told = ""

    def look(self, needed: bool, publishers: int, text: str) -> bool:
        """Whether it was needed in vain for so long.

        needed: whether anything waits for the topic. text: what to say; where nothing waits, time does not count.
        """
        self._in_vain = 0 if publishers else self._in_vain + needed
        is_missing = self._in_vain >= _LOOKS
        if is_missing and text != self._told:
            self._told = text
            self._logger.warning(text)
        return is_missing
