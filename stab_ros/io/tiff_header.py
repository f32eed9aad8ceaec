"""The first directory of a TIFF file (TIFF 6.0), checked before a decoder allocates anything."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from stab_ros.core.errors import MessageError

MAGIC = (b"II*\0", b"MM\0*")
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _SAMPLES, _STRIP_BYTES, _PLANES = 256, 257, 258, 259, 277, 279, 284
_TILE_WIDTH, _SAMPLE_FORMAT = 322, 339
_FORMATS = {1: "B", 3: "H", 4: "I"}  # of the types BYTE, SHORT and LONG
_COMPRESSIONS = (1, 5, 8, 32773, 32946)  # none, LZW, deflate, PackBits
_MOST_ENTRIES, _MOST_VALUES = 100, 100_000


@dataclass(frozen=True)
class TiffHeader:
    """Size of the image, and bits of each of its values."""

    width: int
    height: int
    bits: int


def read_tiff_header(data: bytes) -> TiffHeader:
    """Reads the header of a TIFF as a camera or image_transport writes it.

    Args:
        data: the file.

    Returns:
        The header of its first page.

    Raises:
        MessageError: it is damaged or cut short, or of a kind that is not read.
    """
    try:
        tags = _tags(data, "<" if data[:2] == b"II" else ">")
        bits = set(tags.get(_BITS, (1,)))
        header = TiffHeader(tags[_WIDTH][0], tags[_HEIGHT][0], max(bits))
        stored = sum(tags[_STRIP_BYTES]) if _TILE_WIDTH not in tags else 0
    except (struct.error, KeyError, IndexError) as error:
        raise MessageError("compressed image data is damaged, the TIFF has no complete directory") from error
    usual = (bits <= {8, 16} and len(bits) == 1 and _TILE_WIDTH not in tags
             and set(tags.get(_SAMPLE_FORMAT, (1,))) == {1} and tags.get(_SAMPLES, (1,))[0] in (1, 3, 4)
             and tags.get(_PLANES, (1,))[0] == 1 and tags.get(_COMPRESSION, (1,))[0] in _COMPRESSIONS)
    if not usual:
        raise MessageError("compressed image data is a TIFF that is not read, it must be of 8 or 16 bits in strips, "
                           "plain or packed by LZW, deflate or PackBits; set the publisher's format to png or jpeg")
    if stored > len(data):
        raise MessageError(f"compressed image data of {len(data)} bytes is cut short, the strips of the TIFF take "
                           f"{stored}")
    return header


def _tags(data: bytes, order: str) -> dict[int, tuple[int, ...]]:
    """The whole numbers of the first directory, by tag."""
    (start,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, start)
    found: dict[int, tuple[int, ...]] = {}
    for number in range(min(entries, _MOST_ENTRIES)):
        at = start + 2 + 12 * number
        tag, kind, count = struct.unpack_from(order + "HHI", data, at)
        if kind in _FORMATS and 0 < count <= _MOST_VALUES:
            layout = f"{order}{count}{_FORMATS[kind]}"
            place = at + 8 if struct.calcsize(layout) <= 4 else struct.unpack_from(order + "I", data, at + 8)[0]
            found[tag] = struct.unpack_from(layout, data, place)
    return found
