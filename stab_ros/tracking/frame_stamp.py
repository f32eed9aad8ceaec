"""A frame's place in the stream."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrameStamp:
    """index: number in the stream, from 0. stamp_ns: of its header, may jump. time_ns: of the stream (`Timeline`)."""

    index: int
    stamp_ns: int
    time_ns: int
