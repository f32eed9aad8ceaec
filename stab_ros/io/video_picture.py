"""A decoded frame of a video as the picture that a player shows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass
from fractions import Fraction

import numpy as np
from av.buffer import Buffer
from av.filter import Graph
from av.video.frame import VideoFrame

from stab_ros.core.types import Image

_ONE = 1 << 16  # of a display matrix, in 16.16 fixed point
_SLANT = 0.01
# pixel formats without colour -> the format to read, the encoding of the frame; all others become bgr8
_GREY = {"gray": ("gray", "mono8"),
         **dict.fromkeys(("gray10le", "gray12le", "gray14le", "gray16le", "gray16be"), ("gray16le", "mono16"))}


@dataclass(frozen=True)
class Turn:
    """A display matrix: pixel (x, y) is shown at (a x + c y, b x + d y), y down; quarter turns and flips."""

    a: int = 1
    b: int = 0
    c: int = 0
    d: int = 1

    def __str__(self) -> str:
        return _NAMES[self]

    def __call__(self, image: Image) -> Image:
        """image: (h, w) or (h, w, 3)."""
        turned = image if self.a else np.swapaxes(image, 0, 1)
        turned = turned[:, ::-1] if self.a + self.c < 0 else turned
        return np.ascontiguousarray(turned[::-1] if self.b + self.d < 0 else turned)


def turn_of(frame: VideoFrame) -> tuple[Turn, str]:
    """The turn that the frame asks players for, and what is left undone of it, in words.

    No turn at all, where it is more than quarter turns and flips; "": nothing is left undone.
    """
    asked = _asked(frame)
    turn = Turn(*(round(number) for number in asked))
    slant = max(abs(number - taken) for number, taken in zip(asked, astuple(turn), strict=True))
    return (turn, "") if turn in _NAMES and slant < _SLANT else (Turn(), _in_words(*asked))


def _in_words(a: float, b: float, c: float, d: float) -> str:
    """What a display matrix does that is no `Turn`."""
    if max(abs(a - d), abs(b + c), abs(math.hypot(a, b) - 1)) > _SLANT:
        return "stretched or slanted"
    angle = math.degrees(math.atan2(b, a))
    return f"turned {'clockwise' if angle > 0 else 'anticlockwise'} by {abs(angle):.3g} degrees"


def _asked(frame: VideoFrame) -> tuple[float, float, float, float]:
    """a, b, c, d of its display matrix; those of the identity if it has none."""
    data = frame.side_data.get("DISPLAYMATRIX")
    if not isinstance(data, Buffer):
        return 1.0, 0.0, 0.0, 1.0
    a, b, _, c, d = (int(number) / _ONE for number in np.frombuffer(bytes(data), "=i4")[:5])
    return a, b, c, d


_NAMES = {
    Turn(): "",
    Turn(0, 1, -1, 0): "turned clockwise by 90 degrees",
    Turn(-1, 0, 0, -1): "turned by 180 degrees",
    Turn(0, -1, 1, 0): "turned anticlockwise by 90 degrees",
    Turn(-1, 0, 0, 1): "mirrored",
    Turn(1, 0, 0, -1): "turned upside down",
    Turn(0, 1, 1, 0): "transposed",
    Turn(0, -1, -1, 0): "transposed about the other diagonal",
}


class Deinterlacer:
    """Fills in the lines of a frame's first field where the frame is interlaced: its two fields show different moments.

    Attributes:
        filled: number of frames that were interlaced.
    """

    def __init__(self, tick_s: Fraction) -> None:
        self.filled = 0
        self._tick_s = tick_s

    def __call__(self, frames: Iterable[VideoFrame]) -> Iterator[VideoFrame]:
        """All frames in their order, with their times; one late from the first interlaced one on."""
        graph: _FieldFilter | None = None
        for frame in frames:
            self.filled += frame.interlaced_frame
            if graph and graph.layout != _layout_of(frame):
                yield from graph.end()
                graph = None
            if graph is None and frame.interlaced_frame:
                graph = _FieldFilter(frame, self._tick_s)
            yield from graph.push(frame) if graph else (frame,)
        if graph:
            yield from graph.end()


class _FieldFilter:
    """FFmpeg's bwdif for frames of one size and pixel format; those that are not interlaced pass as they are."""

    def __init__(self, first: VideoFrame, tick_s: Fraction) -> None:
        self.layout = _layout_of(first)
        width, height, pixels = self.layout
        graph = Graph()
        self._source = graph.add("buffer", f"video_size={width}x{height}:pix_fmt={pixels}:time_base={tick_s}:"
                                           "pixel_aspect=1/1")
        fill = graph.add("bwdif", "mode=send_frame:parity=auto:deint=interlaced")
        self._sink = graph.add("buffersink")
        self._source.link_to(fill)
        fill.link_to(self._sink)
        graph.configure()
        self._graph = graph
        self._times: deque[int | None] = deque()

    def push(self, frame: VideoFrame) -> Iterator[VideoFrame]:
        self._times.append(frame.pts)
        self._source.push(frame)
        return self._pull()

    def end(self) -> Iterator[VideoFrame]:
        self._source.push(None)
        return self._pull()

    def _pull(self) -> Iterator[VideoFrame]:
        while self._times:
            try:
                frame = self._sink.pull()
            except (BlockingIOError, EOFError):  # it waits for the next frame, or is empty
                return
            if isinstance(frame, VideoFrame):
                frame.pts = self._times.popleft()
                yield frame


def _layout_of(frame: VideoFrame) -> tuple[int, int, str]:
    return frame.width, frame.height, frame.format.name


def picture_of(frame: VideoFrame) -> tuple[Image, str]:
    """The pixels, by swscale with the matrix and the range that the frame names, and their encoding.

    (h, w) uint8 or uint16 without colour, (h, w, 3) uint8 with it.
    """
    pixels, encoding = _GREY.get(frame.format.name, ("bgr24", "bgr8"))
    return np.ascontiguousarray(frame.reformat(format=pixels, interpolation="BICUBIC").to_ndarray()), encoding
