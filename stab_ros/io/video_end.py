"""Whether a video file ends too early, where FFmpeg's demuxer hands over what there is and says nothing."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from stab_ros.io.video_stream import lacks_times
from stab_ros.io.video_tail import Tail

_GIF_END, _GIF_EXTENSION, _GIF_IMAGE = b";", 0x21, 0x2C
_JPEG_SCAN, _JPEG_END = b"\xff\xda", b"\xff\xd9"  # neither can be within the coded picture
_TS_SYNC, _TS_SIZES = 0x47, ((0, 188), (4, 192), (0, 204))  # place of the sync byte, packet size
_OGG_PAGE, _OGG_MOST, _OGG_LAST = b"OggS", 65307, 4
_RIFF_UNKNOWN = 0xFFFFFFFF  # where the writer could not go back, as into a pipe
_MATROSKA_SEGMENT = bytes.fromhex("18538067")
_ASF_FILE_PROPERTIES = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365")
_PASS_TORN_FRAMES = {"mpegts", "mpeg", "asf"}  # and what has no container


class Ending:
    """Looks at the packets of a stream for the signs of a whole end."""

    def __init__(self, container: InputContainer, stream: VideoStream) -> None:
        self._path = Path(container.name)
        self._stream = stream
        self._format = container.format.name
        self._tail = Tail(stream) if lacks_times(stream) or self._format in _PASS_TORN_FRAMES else None
        self._first: Packet[VideoStream] | None = None
        self._last: Packet[VideoStream] | None = None

    def add(self, packet: Packet[VideoStream]) -> None:
        self._first = self._first or packet
        self._last = packet
        if self._tail:
            self._tail.add(packet)

    def is_torn(self) -> bool:
        """Is the last packet less than a frame?"""
        codec = self._stream.codec_context.name
        if codec == "mjpeg":  # some cameras mark no end at all
            return not _is_closed(self._last) and (self._last is self._first or _is_closed(self._first))
        if codec == "gif":
            return not _holds_gif_image(_data(self._last))
        return self._tail is not None and self._tail.fails_at_last()

    def is_cut(self) -> bool:
        """Does the file lack its end, be its last frame whole or not?"""
        last = self._last
        if self._format == "gif":
            return not _data(last).rstrip(b"\0").endswith(_GIF_END)
        if self._format == "yuv4mpegpipe":
            return last is not None and last.pos is not None and last.pos + last.size < self._path.stat().st_size
        return self._format in _CUT and _CUT[self._format](self._path)


def _data(packet: Packet[VideoStream] | None) -> bytes:
    return bytes(packet) if packet else b""


def _is_closed(jpeg: Packet[VideoStream] | None) -> bool:
    data = _data(jpeg)
    return data.rfind(_JPEG_END) > data.rfind(_JPEG_SCAN)


def _holds_gif_image(data: bytes) -> bool:
    """Is the first image of these blocks there to its end? GIF89a, sections 15 to 27."""
    at = 13 + _table_size(data[10]) if data.startswith(b"GIF") and len(data) > 10 else 0
    while at + 10 < len(data):
        if data[at] == _GIF_EXTENSION:
            at = _after_parts(data, at + 2)
        elif data[at] == _GIF_IMAGE:
            return _after_parts(data, at + 11 + _table_size(data[at + 9])) <= len(data)
        else:
            return True  # nothing that is known
    return False


def _table_size(flags: int) -> int:
    return 3 << (flags & 7) + 1 if flags & 0x80 else 0


def _after_parts(data: bytes, at: int) -> int:
    """The place after parts that each begin with their size, to an empty one; beyond the end if that lacks."""
    while at < len(data) and data[at]:
        at += 1 + data[at]
    return at + 1


def _is_cut_transport(path: Path) -> bool:
    """Is the last packet of a transport stream less than one?"""
    with path.open("rb") as file:
        head = file.read(1024)
    size = next((size for at, size in _TS_SIZES if set(head[at::size]) == {_TS_SYNC}), None)
    return size is not None and path.stat().st_size % size != 0


def _is_cut_ogg(path: Path) -> bool:
    """Is the last page not the last one of a stream, or less than one? RFC 3533, section 6."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2 * _OGG_MOST), os.SEEK_SET)
        tail = file.read()
    page = tail[max(0, tail.rfind(_OGG_PAGE)) :]
    sizes = page[27 : 27 + page[26]] if len(page) > 26 else b""
    return not sizes or len(page) < 27 + len(sizes) + sum(sizes) or not page[5] & _OGG_LAST


def _is_cut_asf(path: Path) -> bool:
    """Is the file shorter than its header says? Microsoft's Advanced Systems Format, section 3.2."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    at = head.find(_ASF_FILE_PROPERTIES)
    return at >= 0 and path.stat().st_size < int.from_bytes(head[at + 40 : at + 48], "little")


def _is_cut_avi(path: Path) -> bool:
    """Is the file shorter than its first chunk says, if it does?"""
    with path.open("rb") as file:
        head = file.read(8)
    size = int.from_bytes(head[4:], "little")
    return head.startswith(b"RIFF") and size != _RIFF_UNKNOWN and path.stat().st_size < size


def _is_cut_matroska(path: Path) -> bool:
    """Is the file shorter than its segment says, which follows the EBML header? RFC 8794, sections 4 to 6; RFC 9559."""
    with path.open("rb") as file:
        head = file.read(1 << 12)
    at = head.find(_MATROSKA_SEGMENT) + len(_MATROSKA_SEGMENT)
    if at < len(_MATROSKA_SEGMENT) or at == len(head):
        return False
    length = 9 - head[at].bit_length()  # of the size, bytes
    size = int.from_bytes(head[at : at + length], "big") & ((1 << 7 * length) - 1)
    unknown = (1 << 7 * length) - 1
    return size != unknown and at + length + size > path.stat().st_size


_CUT: Mapping[str, Callable[[Path], bool]] = MappingProxyType({
    "asf": _is_cut_asf, "avi": _is_cut_avi, "matroska,webm": _is_cut_matroska, "mpegts": _is_cut_transport,
    "ogg": _is_cut_ogg,
})
