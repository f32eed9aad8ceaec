"""Warnings in the log, each kind at most once in a while."""

from __future__ import annotations

import time

from rclpy.impl.rcutils_logger import RcutilsLogger

_PERIOD_S = 5.0


class ThrottledWarnings:
    """Unlike rclpy's own throttle, which goes by the line of code, this one goes by the kind of warning."""

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._logged_s: dict[str, float] = {}  # by kind

    def log(self, kind: str, text: str) -> bool:
        """Logs the text unless one of its kind was logged a moment ago; whether it did."""
        now_s = time.monotonic()
        if now_s - self._logged_s.get(kind, -_PERIOD_S) < _PERIOD_S:
            return False
        self._logged_s[kind] = now_s
        self._logger.warning(text)
        return True
