"""Stamps for water levels that come without one: they hold from when they came, by the stamps of the stream."""

from __future__ import annotations

from dataclasses import replace

from stab_ros.io.water_level_message import NO_STAMP, WaterLevel


class LevelStamps:
    """Follows a stream, and stamps the levels beside it."""

    def __init__(self) -> None:
        self._newest_ns: int | None = None  # of the stream
        self._kept: WaterLevel | None = None  # the last level, if it has no stamp

    def stamped(self, level: WaterLevel) -> WaterLevel | None:
        """The level from when it holds: after what the stream has shown; None: the stream has not begun, it waits."""
        if level.stamp_ns != NO_STAMP:
            self._kept = None
            return level
        self._kept = level
        return None if self._newest_ns is None else replace(level, stamp_ns=self._newest_ns + 1)

    def advance(self, stamp_ns: int) -> WaterLevel | None:
        """Takes the next stamp of the stream; the level that holds from there on, where none of its time can.

        It does where the stream begins after the level, and where its stamps go back to before it.
        """
        begins = self._newest_ns is None or stamp_ns < self._newest_ns
        self._newest_ns = stamp_ns
        return replace(self._kept, stamp_ns=stamp_ns) if begins and self._kept is not None else None
