"""A decoder for the packets of one video stream, through FFmpeg (PyAV)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import av
import numpy as np
from av.video.codeccontext import VideoCodecContext
from numpy.typing import NDArray

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Image
from stab_ros.io.compressed_image import MAX_DECODED
from stab_ros.io.h264_gaps import FrameNumbers
from stab_ros.io.video_picture import picture_of

# what messages call a video format -> FFmpeg's decoder. The names are those of Foxglove, and of FFmpeg's encoders
# without the prefix lib and the hardware, as in libx264 and hevc_nvenc.
DECODERS: Mapping[str, str] = MappingProxyType({
    **dict.fromkeys(("h264", "avc", "avc1", "x264", "openh264"), "h264"),
    **dict.fromkeys(("h265", "hevc", "hvc1", "hev1", "x265", "kvazaar"), "hevc"),
    **dict.fromkeys(("av1", "av01", "svtav1", "aom-av1", "rav1e"), "libdav1d"),
    **dict.fromkeys(("vp9", "vp09", "vpx-vp9"), "vp9"), **dict.fromkeys(("vp8", "vpx"), "vp8"),
    "mpeg4": "mpeg4",
})
_FORMATS = "h264, h265, av1, vp9, vp8, mpeg4"
MAX_DELAY = 16  # pictures that H.264 and H.265 may hold back, until all before them are decoded
_MOST_PIXELS = MAX_DECODED // 3
# FFmpeg's H.264 decoder marks a damaged picture; that of H.265 must be told to refuse its packet
_OPTIONS = {"hevc": {"err_detect": "explode"}}
# whose decoder knows when the picture is whole, also in streams that have no key frames but refresh it bit by bit
_H264 = "h264"


@dataclass(frozen=True, eq=False)
class Shown:
    """A decoded picture. number: of its packet. key: decoding can start with it. sound: not known to be damaged."""

    number: int
    key: bool
    sound: bool
    frame: av.VideoFrame

    def image(self) -> tuple[Image, str]:
        """The pixels and their encoding.

        Raises:
            MessageError: the pixel format cannot be converted.
        """
        try:
            return picture_of(self.frame)
        except (av.FFmpegError, ValueError) as error:
            raise MessageError(f"pixels of format {self.frame.format.name} cannot be converted: {error}") from error


class VideoDecoder:
    """Decodes on one thread, so that each picture comes out as early as it can, and always the same.

    Raises:
        MessageError: the format is unknown, or this build of FFmpeg cannot decode it.
    """

    def __init__(self, video_format: str) -> None:
        codec = decoder_of(video_format)
        if codec not in av.codecs_available:
            raise MessageError(f"video format {video_format[:40]!r} cannot be decoded, it must be one of {_FORMATS}")
        context = av.CodecContext.create(codec, "r")
        assert isinstance(context, VideoCodecContext)
        context.thread_count = 1
        context.options = {"max_pixels": str(_MOST_PIXELS), **_OPTIONS.get(codec, {})}
        self._context = context
        self._may_show = self._recovers = codec == _H264
        self._numbers = FrameNumbers() if codec == _H264 else None

    @property
    def reorders(self) -> bool:
        """Whether pictures may come out in another order than their packets."""
        return bool(self._context.has_b_frames)

    def misses_before(self, data: NDArray[np.uint8]) -> bool:
        """Whether packets that this one builds on are missing; told of H.264 alone, as other decoders notice it."""
        return self._numbers is not None and self._numbers.misses_before(data.tobytes())

    def decode(self, number: int, data: NDArray[np.uint8]) -> Sequence[Shown]:
        """The pictures that come out once the packet `number` has gone in, in the order in which they are shown.

        Raises:
            MessageError: the packet is damaged or holds no picture, or what it builds on is missing.
        """
        if not data.size:  # FFmpeg would take it for the end
            raise MessageError("the packet is empty")
        packet = av.Packet(data.tobytes())
        packet.pts = packet.dts = number
        try:
            return self._shown(self._context.decode(packet))
        except av.FFmpegError as error:
            raise MessageError(f"the packet is damaged or incomplete: {error.strerror}") from error

    def finish(self) -> Sequence[Shown]:
        """The pictures that were held back. Decoding can start again then, with a key frame."""
        try:
            shown = self._shown(self._context.decode(None))
        except av.FFmpegError:  # they are lost
            shown = []
        self._context.flush_buffers()
        self._may_show = self._recovers
        return shown

    def _shown(self, frames: Iterable[av.VideoFrame]) -> list[Shown]:
        """From the first key frame on, as what comes before it is grey where it is not new."""
        found = []
        for frame in frames:
            self._may_show = self._may_show or bool(frame.key_frame)
            if self._may_show and frame.pts is not None:
                found.append(Shown(frame.pts, bool(frame.key_frame), not frame.is_corrupt, frame))
        return found


def decoder_of(video_format: str) -> str:
    """FFmpeg's decoder for a format as messages give it, such as "h265" or "libx264;yuv420p"; empty: it is no video."""
    name = re.split(r"[;,: ]", video_format.strip().lower().replace("h.26", "h26"))[0]
    return DECODERS.get(name.removeprefix("lib").partition("_")[0], "")

