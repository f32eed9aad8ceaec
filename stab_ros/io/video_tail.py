"""Decodes the last packets of a stream again, to see whether the last one is less than a frame."""

from __future__ import annotations

from av import CodecContext
from av.error import FFmpegError
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

_MOST_PACKETS, _MOST_BYTES, _MOST_PIXELS = 300, 1 << 26, 500_000_000  # from a key frame on; pixels: 60 frames of 4K
_RUN_IN = 16  # pictures that H.264 and H.265 may refer to or hold back: so many later, all are as they should be


class Tail:
    """The packets from the last key frame on, and, while these are few, those from a key frame before.

    With an open group of pictures, frames that follow its key frame refer to the group before, and so they do with
    intra refresh. Between two key frames that count are at least `_RUN_IN` packets. Of a group that is longer than the
    limits nothing is kept.
    """

    def __init__(self, stream: VideoStream) -> None:
        self._like = stream.codec_context
        pixels = max(1, self._like.width * self._like.height)
        self._most = max(_RUN_IN, min(_MOST_PACKETS, _MOST_PIXELS // pixels))
        self._before: list[Packet[VideoStream]] | None = []  # None: it was too long
        self._group: list[Packet[VideoStream]] | None = []
        self._bytes = 0

    def add(self, packet: Packet[VideoStream]) -> None:
        if packet.is_keyframe and (self._group is None or len(self._group) >= _RUN_IN):
            self._before, self._group, self._bytes = self._group, [], 0
        if self._group is None:
            return
        self._group.append(packet)
        self._bytes += packet.size
        if len(self._group) >= 2 * _RUN_IN:  # the last ones are judged without it
            self._before = []
        if len(self._group) > self._most or self._bytes > _MOST_BYTES:
            self._group = None

    def fails_at_last(self) -> bool:
        """Decoded on one thread, is the last packet the only one with errors? False where that cannot be judged.

        Decoders of several threads do not mark the pictures that they mended.
        """
        if self._group is None or self._before is None:
            return False
        decoder = _strict(self._like)
        sound = [_decodes(decoder, packet) for packet in self._before + self._group]
        judged = sound[max(len(self._before), len(sound) - _RUN_IN) :]
        return all(judged[:-1]) and not (_decodes(decoder, None) and judged[-1])


def _strict(like: VideoCodecContext) -> VideoCodecContext:
    context = CodecContext.create(like.codec.name, "r")
    assert isinstance(context, VideoCodecContext)
    context.extradata = like.extradata
    context.width, context.height = like.width, like.height
    context.thread_count = 1
    context.options = {"err_detect": "explode"}
    return context


def _decodes(decoder: VideoCodecContext, packet: Packet[VideoStream] | None) -> bool:
    """packet: None at the end."""
    try:
        return not any(frame.is_corrupt for frame in decoder.decode(packet))
    except FFmpegError:
        return False
