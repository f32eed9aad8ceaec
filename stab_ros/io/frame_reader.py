"""What video files and folders of images have in common: frames without messages.

Stamps are 1 s + frame/fps, or the times of a video from 1 s on: the first frame is not stamped 0, which ROS takes for
"no time".
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Frame

FRAME_ID = "camera"
DEFAULT_FPS = 25.0
MAX_FPS = 1000.0
FIRST_STAMP_NS = 1_000_000_000

# a frame, or the error that decoding its image raised
Decoded = Frame | MessageError


class FrameReader(Protocol):
    """A stream of frames without messages."""

    @property
    def warnings(self) -> list[str]:
        """What could not be read or may not be expected, one line each; complete once all frames were read."""

    @property
    def fps(self) -> float:
        """Frames per second; their mean, if that varies."""

    @property
    def count(self) -> int | None:
        """Number of frames; None if the file does not announce it."""

    def frames(self) -> Iterator[tuple[int, Decoded]]:
        """Stamp in ns and what was decoded."""

    def close(self) -> None:
        """Closes the file."""


def stamp_ns(frame: int, fps: float) -> int:
    """The stamp of a frame, counted from 0."""
    return FIRST_STAMP_NS + round(frame * 1e9 / fps)
