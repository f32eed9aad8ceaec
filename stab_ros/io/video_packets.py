"""The packets of a video stream, and the frames that they are decoded to."""

from __future__ import annotations

from collections.abc import Iterator

from av.container import InputContainer
from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from stab_ros.io.video_end import Ending

_END_IN_ERROR = {"mpjpeg"}  # JPEG in MIME parts: FFmpeg looks for one after the last


class Packets:
    """Iterates over the coded frames of a stream, once; one that the end of the file cuts off is left out.

    Attributes:
        shown: number of those so far that a player shows: an edit list hides what lies before its start.
        damaged: number of those that the container knows to be damaged, as packets of a transport stream are missing.
        cut: does the file end within a frame? Known at the end.
    """

    def __init__(self, container: InputContainer, stream: VideoStream) -> None:
        self.shown = self.damaged = 0
        self.cut = False
        self._container = container
        self._stream = stream

    def __iter__(self) -> Iterator[Packet[VideoStream]]:
        held: Packet[VideoStream] | None = None  # the last one is judged when it is known to be the last
        ending = Ending(self._container, self._stream)
        for packet in self._demuxed():
            if held is not None:
                yield self._counted(held)
            held = packet
            ending.add(packet)
        if held is None:
            return
        torn = held.is_corrupt or ending.is_torn()
        self.cut = self.cut or torn or ending.is_cut()
        if not torn:  # with it, a decoder with several threads loses frames before it
            yield self._counted(held)

    def is_shown(self, packet: Packet[VideoStream]) -> bool:
        start = self._stream.start_time
        return packet.pts is None or start is None or packet.pts >= start

    def _demuxed(self) -> Iterator[Packet[VideoStream]]:
        try:
            for packet in self._container.demux(self._stream):
                if packet.size:  # an empty one would end the decoder
                    yield packet
        except FFmpegError:
            self.cut = self._container.format.name not in _END_IN_ERROR

    def _counted(self, packet: Packet[VideoStream]) -> Packet[VideoStream]:
        self.shown += self.is_shown(packet)
        self.damaged += packet.is_corrupt
        return packet


def decode(packets: Packets, stream: VideoStream) -> Iterator[VideoFrame]:
    """What can be decoded, in the order of display; decoding goes on after damaged packets."""
    for packet in packets:
        yield from _decoded(stream, packet)
    yield from _decoded(stream, None)


def _decoded(stream: VideoStream, packet: Packet[VideoStream] | None) -> list[VideoFrame]:
    """packet: None at the end, for the frames that the decoder still holds."""
    try:
        return stream.decode(packet)
    except FFmpegError:  # the frames that lack are counted at the end
        return []
