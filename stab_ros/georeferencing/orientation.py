"""The protocol of orientations: ways to know where a frame lies on the water plane (Perks 2020, section 2.2.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

from stab_ros.georeferencing.placement import Placement, Sighting


@dataclass(frozen=True)
class Unplaced:
    """A frame whose place is not known: a value, not an error. reason: one line."""

    reason: str


Answer: TypeAlias = Placement | Unplaced


class Orientation(Protocol):
    """A way to know where frames lie.

    Attributes:
        needs_motion: whether it takes `Sighting.ref_H_cur`.
        needs_sensors: whether it takes positions and attitudes of sensors.
        needs_picture: whether it looks at `Sighting.gray`.
    """

    needs_motion: bool
    needs_sensors: bool
    needs_picture: bool

    def place(self, sighting: Sighting) -> Answer:
        """Places a frame.

        Args:
            sighting: the next frame.

        Returns:
            Where it lies; or why that is not known.

        Raises:
            InputError: the frame, the camera and the settings contradict each other.
        """


@runtime_checkable
class Watching(Protocol):
    """An orientation that watches what it is told over a flight."""

    def last_look(self) -> tuple[str, ...]:
        """What is doubtful of a recording at its end and was not said with a frame, one line each."""
