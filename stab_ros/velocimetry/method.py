"""The protocol of velocimetry methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.vectors import Vectors


class Method(Protocol):
    """Measures velocities in the frames of a stream; knows no files, messages or clock."""

    @property
    def follows(self) -> bool:
        """Whether vectors begin and end where something was seen; else they are what was measured in their middle."""

    @property
    def dropped(self) -> Mapping[str, int]:
        """How many vectors of the last interval were dropped, by reason; empty where the method counts none."""

    @property
    def doubts(self) -> Mapping[str, str]:
        """What is doubtful of the last interval, in words, by kind."""

    def add(self, frame: PlacedFrame) -> Vectors | None:
        """Takes the next frame.

        Args:
            frame: the next one, with a stamp after that of the one before.

        Returns:
            The vectors of the interval that ends with this frame; None: it has not ended yet.
        """

    def finish(self) -> Vectors | None:
        """The vectors of the interval that was under way when the stream ended; None: it was too short for any."""
