"""The protocol of ways to follow the features of an interval."""

from __future__ import annotations

from typing import Protocol

from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.tracks import Tracks


class Follower(Protocol):
    """Follows the features of one interval; constructed with its first frame and the pixels of the features."""

    @property
    def tracks(self) -> Tracks:
        """The features so far."""

    def follow(self, frame: PlacedFrame) -> None:
        """Finds the features in the next frame."""

    def finish(self) -> Tracks:
        """The tracks with their covariance."""
