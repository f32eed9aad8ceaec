"""Errors that nobody foresaw: counted and logged, and never the end of a node."""

from __future__ import annotations

import traceback
from pathlib import Path
from types import TracebackType

from rclpy.impl.rcutils_logger import RcutilsLogger

from stab_ros.core.errors import StabRosError
from stab_ros.core.text import one_line


class Failures:
    """A context that ends where an error escapes its body; errors that stab_ros raises on purpose pass through.

    count: number of errors so far. last: the last one in words, "" for none.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self.count, self.last = 0, ""
        self._logger = logger
        self._kinds: set[str] = set()

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not isinstance(error, Exception) or isinstance(error, StabRosError):
            return False
        self.note(error)
        return True

    def note(self, error: Exception) -> None:
        """Counts an error; the first of its type and place is logged with its traceback."""
        frames = traceback.extract_tb(error.__traceback__)
        place = f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else "unknown place"
        self.count += 1
        self.last = f"internal error: {one_line(error) or 'without a message'} ({type(error).__name__} in {place})"
        kind = f"{type(error).__name__} {place}"
        if kind not in self._kinds:
            self._kinds.add(kind)
            trace = "".join(traceback.format_exception(error))
            self._logger.error(f"{self.last}; the node goes on, later ones of this kind are only counted on "
                               f"/diagnostics; please report this:\n{trace}")
