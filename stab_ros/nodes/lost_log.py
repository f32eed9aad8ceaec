"""Tells in the log where frames begin to be lost, and where they are found again."""

from __future__ import annotations

from rclpy.impl.rcutils_logger import RcutilsLogger

from stab_ros.core.text import counted
from stab_ros.core.types import LostReason, Track
from stab_ros.io.advice import to_try
from stab_ros.nodes.throttled_warnings import ThrottledWarnings


class LostLog:
    """A warning for the first lost frame of a row, not for each; none where the last one was a moment ago.

    Frames of a start that are to be LOST are none.
    """

    def __init__(self, logger: RcutilsLogger, warnings: ThrottledWarnings) -> None:
        self._logger, self._warnings = logger, warnings
        self._lost = 0  # frames in a row, so far
        self._told = False  # whether that was logged

    def on_track(self, track: Track) -> None:
        """The answer to the next frame."""
        if track.lost_reason is None:
            self._found(track)
            return
        if track.lost_reason is LostReason.STARTING:
            return
        self._lost += 1
        if self._lost == 1:
            self._told = self._warnings.log("lost", f"frames are LOST from stamp {track.stamp_ns} ns on: "
                                            f"{track.lost_reason.value}: {to_try(track.lost_reason)}")

    def _found(self, track: Track) -> None:
        if self._told:
            self._logger.info(f"tracked again from stamp {track.stamp_ns} ns on, "
                              f"after {counted(self._lost, 'lost frame')}")
        self._lost, self._told = 0, False
