"""The header of a WebP file (RFC 9649), checked before a decoder allocates anything."""

from __future__ import annotations

import struct

from stab_ros.core.errors import MessageError

_ANIMATED = 0x02


def is_webp(data: bytes) -> bool:
    """Whether the file claims to be one."""
    return data[:4] == b"RIFF" and data[8:12] == b"WEBP"


def read_webp_size(data: bytes) -> tuple[int, int]:
    """Width and height, px, of a WebP file.

    Raises:
        MessageError: it is damaged, cut short or animated.
    """
    if len(data) < 30 or int.from_bytes(data[4:8], "little") + 8 > len(data):
        raise MessageError("compressed image data is cut short, the WebP ends later")
    kind = data[12:16]
    if kind == b"VP8X":
        if data[20] & _ANIMATED:
            raise MessageError("compressed image data is an animated WebP, it must be a single image")
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        (packed,) = struct.unpack_from("<I", data, 21)
        return 1 + (packed & 0x3FFF), 1 + (packed >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    raise MessageError(f"compressed image data is damaged, the WebP begins with {kind!r}")
