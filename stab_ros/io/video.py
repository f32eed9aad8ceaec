"""Video files as streams of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import islice
from pathlib import Path

from av.error import FFmpegError

from stab_ros.core.errors import InputError
from stab_ros.core.text import are, counted, one_line
from stab_ros.core.types import Frame
from stab_ros.io.frame_reader import FRAME_ID, Decoded
from stab_ros.io.video_clock import Pace, VideoClock, pace
from stab_ros.io.video_packets import Packets, decode
from stab_ros.io.video_picture import Deinterlacer, Turn, picture_of, turn_of
from stab_ros.io.video_stream import (
    announced_frames,
    announced_s,
    choose_stream,
    codec_of,
    lacks_times,
    open_container,
    others,
    stretched,
    timing_of,
    undecodable,
)

VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".wmv",
                  ".flv", ".3gp", ".ogv", ".mjpeg", ".mjpg", ".y4m", ".h264", ".h265", ".hevc", ".mxf", ".gif")
_SAME_RATE = 5e-4  # relative: 29.97 and 30 are two rates
_MISSING_SHARE, _MISSING_FRAMES = 0.1, 5  # at the end, from which on a file counts as cut


@dataclass(frozen=True)
class VideoFacts:
    """What a video file says of itself, and what its packets say.

    Attributes:
        codec, pixels: names of codec and pixel format in FFmpeg.
        nominal_fps: the rate that the file names, frames/s.
        timed: does it hold times of presentation?
        pace: number of frames and the steps between them.
        cut: does the file end early, within a frame or with fewer than it announces?
    """

    codec: str
    pixels: str
    nominal_fps: float
    timed: bool
    pace: Pace
    cut: bool


class VideoFile:
    """A video, decoded by FFmpeg as a player shows it: turned upright, fields filled in.

    Raises:
        InputError: the file cannot be decoded (constructor and frames).
    """

    def __init__(self, path: Path, fps: float | None) -> None:
        self._path = path
        self._container = open_container(path)
        self._stream = choose_stream(path, self._container)
        self._stream.thread_type = "AUTO"
        self._given_fps = fps
        self._timing = timing_of(self._stream, fps)
        said = [*others(self._container, self._stream), *stretched(path, self._stream)]
        self.warnings = [f"{path}: {line}" for line in said]

    @property
    def count(self) -> int | None:
        """As announced; that includes what an edit list hides, which the duration does not."""
        by_time = round((announced_s(self._container, self._stream) or 0) * self._timing.fps)
        return min((count for count in (announced_frames(self._stream), by_time) if count), default=None)

    @property
    def fps(self) -> float:
        """The nominal rate or, where the times vary, the mean one: for it all packets are read."""
        return self._given_fps or self.facts.pace.fps

    @cached_property
    def facts(self) -> VideoFacts:
        """Read from all packets of the file; decoded only where a packet may be a field, half a frame."""
        with open_container(self._path) as container:
            stream = choose_stream(self._path, container)
            packets, timing = Packets(container, stream), timing_of(stream, None)
            if self._is_interlaced():
                times = [frame.pts for frame in decode(packets, stream)]
            else:
                times = [packet.pts for packet in packets if packets.is_shown(packet)]
        timed = timing.tick_s is not None and any(pts is not None for pts in times)
        steps = pace(timing, times)
        return VideoFacts(codec_of(self._stream), self._stream.codec_context.pix_fmt or "unknown pixels",
                          float(timing.fps), timed, steps, packets.cut or self._ends_early(steps.duration_s))

    def frames(self) -> Iterator[tuple[int, Decoded]]:
        packets, clock = Packets(self._container, self._stream), VideoClock(self._timing)
        fields = Deinterlacer(self._stream.time_base or Fraction(1, 90_000))
        turn = None
        try:
            for shown in fields(decode(packets, self._stream)):
                if turn is None:
                    turn, undone = turn_of(shown)
                    self._tell(turn, undone, fields)
                stamp = clock.stamp_ns(shown.pts)
                pixels, encoding = picture_of(shown)
                yield stamp, Frame(turn(pixels), encoding, stamp, FRAME_ID)
        except FFmpegError as error:
            raise undecodable(self._path, codec_of(self._stream), one_line(error.strerror)) from error
        if packets.shown == 0:
            raise InputError(f"{self._path}: is cut off before the end of its first frame; it must hold one")
        if clock.frames == 0:
            raise undecodable(self._path, codec_of(self._stream))
        self._warn(packets, clock, fields)

    def close(self) -> None:
        self._container.close()

    def _is_interlaced(self) -> bool:
        with open_container(self._path) as container:
            stream = choose_stream(self._path, container)
            return any(frame.interlaced_frame for frame in islice(decode(Packets(container, stream), stream), 1))

    def _tell(self, turn: Turn, undone: str, fields: Deinterlacer) -> None:
        """With the first frame: what is done to all, and what is not."""
        if str(turn):
            self.warnings.append(f"{self._path}: frames are {turn}, as the file asks players to do")
        if own := self._set_aside():
            self.warnings.append(f"{self._path}: {own}")
        if undone:
            self.warnings.append(f"{self._path}: frames are taken as stored; the file asks players to show them "
                                 f"{undone}, and only flips and multiples of 90 degrees are done")
        if fields.filled:
            self.warnings.append(f"{self._path}: interlaced; the lines of the first field of a frame are kept, and the "
                                 "others filled in, as they show another moment")

    def _set_aside(self) -> str:
        """That the given rate is not that of the file's times; empty where it is, or there are none."""
        own = timing_of(self._stream, None)
        factor = (self._given_fps or float(own.fps)) / float(own.fps)
        if own.tick_s is None or abs(factor - 1) < _SAME_RATE:
            return ""
        return (f"its times say {float(own.fps):g} frames/s, and {self._given_fps:g} are taken as given (--fps): "
                f"speeds are {factor:.4g} times those by its times")

    def _warn(self, packets: Packets, clock: VideoClock, fields: Deinterlacer) -> None:
        """After the last frame: what was not as it should be."""
        number = clock.frames
        frames = f"of its {counted(max(packets.shown, number), 'frame')}"  # packets of interlaced video may be fields
        said = {
            f"{number} {frames} can be decoded": number < packets.shown and not fields.filled,
            f"{packets.damaged} {frames} {are(packets.damaged)} damaged in the file; pictures may be wrong up to the "
            "next key frame":
                packets.damaged > 0,
            f"it is cut off after {counted(number, 'frame')}": packets.cut or self._ends_early(clock.duration_s),
            f"holds no times; frame n is stamped 1 s + n/{float(self._timing.fps):g} s (--fps sets another rate)":
                clock.missing == number or (lacks_times(self._stream) and self._given_fps is None),
            f"the times of {clock.missing + clock.wrong} {frames} are missing, repeat or go back; they follow their "
            "neighbours": clock.wrong > 0 or 0 < clock.missing < number,
        }
        self.warnings += [f"{self._path}: {line}" for line, true in said.items() if true]

    def _ends_early(self, duration_s: float) -> bool:
        """duration_s: from the first frame to the last."""
        announced, frame = announced_s(self._container, self._stream), 1 / float(self._timing.fps)
        if announced is None or self._given_fps:
            return False
        return announced - frame - duration_s > max(_MISSING_SHARE * announced, _MISSING_FRAMES * frame)
