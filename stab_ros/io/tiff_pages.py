"""The pages of a TIFF file, each as a TIFF file of its own (TIFF 6.0 and BigTIFF).

OpenCV decodes the first page of a file; for a later one its `imreadmulti` goes through all pages before it. So a page
is cut out, its strips or tiles as they are: no more than one page is in memory, and each takes the same time.

ImageJ writes stacks above 4 GB with one directory: the pixels of the other images follow those of the first.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_INTEGERS = {1: "u1", 3: "u2", 4: "u4", 13: "u4", 16: "u8"}  # by type of a field
_LONG, _LONG8 = 4, 16
_SUBFILE_TYPE, _WIDTH, _HEIGHT, _BITS, _COMPRESSION, _DESCRIPTION, _ORIENTATION = 254, 256, 257, 258, 259, 270, 274
_NO_COMPRESSION = (0, 1)
_IMAGEJ = re.compile(rb"ImageJ=.*?^images=([0-9]{1,9})$", re.DOTALL | re.MULTILINE)  # its description of a stack
_SHORT, _UPRIGHT = 3, 1
_SEGMENTS = ((273, 279), (324, 325))  # tags of offsets and byte counts, of strips and of tiles
_ELSEWHERE = (330, 34665, 34853, 40965)  # tags that point at directories outside of the page
_NO_FRAME = 0b101  # bits of _SUBFILE_TYPE: a smaller version of another page, a mask
_MOST_FIELDS = 2**16  # of a directory


class DamagedTiffError(Exception):
    """The bytes are no TIFF file, or a damaged one."""


@dataclass(frozen=True)
class TiffPage:
    """offset: of its directory in the file. size: width, height, px, as stored. is_frame: neither thumbnail nor mask.

    orientation: as that of EXIF, 1 to 8; what is missing or unknown is 1. plane: how many images lie between the pixels
    that the directory points at and those of this page.
    """

    offset: int
    size: tuple[int, int]
    is_frame: bool
    orientation: int
    plane: int = 0


class _Field(NamedTuple):
    """An entry of a directory. values: how many. content: they, or their offset. place: of the entry in the file."""

    tag: int
    kind: int
    values: int
    content: bytes
    place: int

    @property
    def length(self) -> int:
        """Bytes of all values."""
        return self.values * _BYTES.get(self.kind, 1)


class _Directory(NamedTuple):
    """fields: by tag. following: the offset of the next directory, 0 for none. length: of all fields, bytes."""

    fields: Mapping[int, _Field]
    following: int
    length: int


class TiffFile:
    """An open TIFF file.

    Raises:
        DamagedTiffError: it is none.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._size = file, file.seek(0, 2)
        head = self._read(0, 8)
        self._order = {b"II\x2a\x00": "<", b"MM\x00\x2a": ">", b"II\x2b\x00": "<", b"MM\x00\x2b": ">"}.get(head[:4], "")
        if not self._order:
            raise DamagedTiffError("is no TIFF file")
        big = 43 in head[2:4]
        self._count, self._offset = (struct.Struct(self._order + code) for code in ("QQ" if big else "HI"))
        self._entry = struct.Struct(self._order + ("HHQ8s" if big else "HHI4s"))
        self._head = self._read(0, 16 if big else 8)
        (self._first,) = self._offset.unpack(self._head[-self._offset.size :])

    def pages(self) -> Iterator[TiffPage]:
        """The pages in their order.

        Raises:
            DamagedTiffError: where the file is damaged, after the pages before that.
        """
        offset, seen, length = self._first, set[int](), 0
        while offset and offset not in seen:
            seen.add(offset)
            directory = self._directory(offset)
            length += directory.length
            if length > self._size:
                raise DamagedTiffError("holds directories that overlap")
            page = self._page(offset, directory.fields)
            yield page
            if offset == self._first and not directory.following:
                yield from self._planes(page, directory.fields)
            offset = directory.following

    def _page(self, offset: int, fields: Mapping[int, _Field]) -> TiffPage:
        width, height, kind = (self._number(fields, tag) for tag in (_WIDTH, _HEIGHT, _SUBFILE_TYPE))
        told = _ORIENTATION in fields and fields[_ORIENTATION].kind in _INTEGERS
        orientation = self._number(fields, _ORIENTATION) if told else _UPRIGHT
        known = orientation if 1 <= orientation <= 8 else _UPRIGHT
        return TiffPage(offset, (width, height), not kind & _NO_FRAME, known)

    def _planes(self, page: TiffPage, fields: Mapping[int, _Field]) -> Iterator[TiffPage]:
        """The images after the first of a stack with one directory; none where the file has no room for any."""
        told = _IMAGEJ.match(self._description(fields))
        images = int(told[1]) if told else 1
        room = self._room(fields) if images > 1 else 1
        if room < 2:
            return
        if not self._is_plain(page.size, fields):
            raise DamagedTiffError(f"lacks the directories of its {images} images (ImageJ saves an image sequence)")
        yield from (replace(page, plane=plane) for plane in range(1, min(images, room)))
        if room < images:
            raise DamagedTiffError("is cut short")

    def _description(self, fields: Mapping[int, _Field]) -> bytes:
        """Of an image; what cannot be read is none, as no decoder needs it."""
        try:
            return self._value(fields[_DESCRIPTION]) if _DESCRIPTION in fields else b""
        except DamagedTiffError:
            return b""

    def _room(self, fields: Mapping[int, _Field]) -> int:
        """How many images as the first fit in the file from its first strip on; 0: there is no strip."""
        at, counts = _SEGMENTS[0]
        if at not in fields or counts not in fields:
            return 0
        offsets, length = self._integers(fields[at]), int(self._integers(fields[counts]).sum(dtype=np.float64))
        return (self._size - int(offsets[0])) // length if len(offsets) and length else 0

    def _is_plain(self, size: tuple[int, int], fields: Mapping[int, _Field]) -> bool:
        """Whether an image is not compressed, and its strips, of which there must be one, follow each other."""
        offsets, lengths = (self._integers(fields[tag]) for tag in _SEGMENTS[0])
        bits = self._integers(fields[_BITS]).sum(dtype=np.float64) if _BITS in fields else 1  # of a pixel
        whole = 8 * lengths.sum(dtype=np.float64) == size[0] * size[1] * bits
        joined = np.array_equal(offsets[1:], (offsets[0] + np.cumsum(lengths))[:-1])
        return bool(whole and joined and self._number(fields, _COMPRESSION) in _NO_COMPRESSION)

    def cut(self, page: TiffPage) -> bytes:
        """The page alone, as a TIFF file without orientation.

        Raises:
            DamagedTiffError: it is damaged.
        """
        left_out = (*_ELSEWHERE, _ORIENTATION)
        fields = {tag: field for tag, field in self._directory(page.offset).fields.items() if tag not in left_out}
        if sum(field.length for field in fields.values()) > self._size:
            raise DamagedTiffError("holds fields that overlap")
        values = {tag: self._value(field) for tag, field in fields.items()}
        at, counts = next(((at, counts) for at, counts in _SEGMENTS if at in fields and counts in fields), (0, 0))
        if not at:
            raise DamagedTiffError("has a page without pixels")
        lengths = self._integers(fields[counts])
        behind = np.uint64(page.plane * int(lengths.sum(dtype=np.float64)))
        segments = self._segments(self._integers(fields[at]) + behind, lengths)
        width = self._offset.size
        kinds = {tag: field.kind for tag, field in fields.items()} | {at: _LONG8 if width == 8 else _LONG}
        values[at] = bytes(len(segments) * width)
        start = self._body_start(len(fields)) + sum(len(value) for value in values.values() if len(value) > width)
        places = start + np.cumsum([0, *map(len, segments[:-1])])
        values[at] = places.astype(f"{self._order}u{width}").tobytes()
        counted = {tag: len(segments) if tag == at else field.values for tag, field in fields.items()}
        return b"".join([self._written(kinds, counted, values), *segments])

    def upright(self) -> bytes:
        """The file with an orientation of 1 in its first page, so that no decoder turns it.

        Raises:
            DamagedTiffError: it is damaged.
        """
        field = self._directory(self._first).fields.get(_ORIENTATION)
        data = self._read(0, self._size)
        if field is None:
            return data
        one = struct.pack(f"{self._order}H", _UPRIGHT).ljust(self._offset.size, b"\0")
        entry = self._entry.pack(_ORIENTATION, _SHORT, 1, one)
        return b"".join([data[: field.place], entry, data[field.place + len(entry) :]])

    def _segments(self, offsets: NDArray[np.uint64], lengths: NDArray[np.uint64]) -> list[bytes]:
        if not len(offsets) or len(offsets) != len(lengths) or int(lengths.sum(dtype=np.float64)) > self._size:
            raise DamagedTiffError("has a page whose strips contradict each other")
        return [self._read(int(offset), int(length)) for offset, length in zip(offsets, lengths, strict=True)]

    def _body_start(self, fields: int) -> int:
        return len(self._head) + self._count.size + fields * self._entry.size + self._offset.size

    def _written(self, kinds: Mapping[int, int], counts: Mapping[int, int], values: Mapping[int, bytes]) -> bytes:
        """Head and directory of a file of one page, and the values that the directory has no room for."""
        width = self._offset.size
        head = self._head[:-width] + self._offset.pack(len(self._head)) + self._count.pack(len(values))
        place, entries, body = self._body_start(len(values)), [], []
        for tag, value in sorted(values.items()):
            content = value.ljust(width, b"\0") if len(value) <= width else self._offset.pack(place)
            entries.append(self._entry.pack(tag, kinds[tag], counts[tag], content))
            if len(value) > width:
                body.append(value)
                place += len(value)
        return b"".join([head, *entries, bytes(width), *body])

    def _directory(self, offset: int) -> _Directory:
        (count,) = self._count.unpack(self._read(offset, self._count.size))
        if count > _MOST_FIELDS:
            raise DamagedTiffError("has a directory of too many fields")
        length = count * self._entry.size
        data = self._read(offset + self._count.size, length + self._offset.size)
        start = offset + self._count.size
        fields = [_Field._make((*entry, start + number * self._entry.size))
                  for number, entry in enumerate(self._entry.iter_unpack(data[:length]))]
        (following,) = self._offset.unpack(data[length:])
        return _Directory({field.tag: field for field in fields}, following, length)

    def _value(self, field: _Field) -> bytes:
        if field.length <= self._offset.size:
            return field.content[: field.length]
        (offset,) = self._offset.unpack(field.content)
        return self._read(offset, field.length)

    def _integers(self, field: _Field) -> NDArray[np.uint64]:
        if field.kind not in _INTEGERS:
            raise DamagedTiffError("has a field of a wrong type")
        return np.frombuffer(self._value(field), self._order + _INTEGERS[field.kind]).astype(np.uint64)

    def _number(self, fields: Mapping[int, _Field], tag: int) -> int:
        """The one value of a field; 0 where there is none."""
        return int(self._integers(fields[tag])[0]) if tag in fields and fields[tag].values == 1 else 0

    def _read(self, offset: int, length: int) -> bytes:
        if offset + length > self._size:
            raise DamagedTiffError("is cut short")
        self._file.seek(offset)
        data = self._file.read(length)
        if len(data) < length:
            raise DamagedTiffError("is cut short")
        return data


def upright(data: bytes) -> bytes:
    """A TIFF file that no decoder turns; any other file, and a damaged one, as it is."""
    try:
        return TiffFile(io.BytesIO(data)).upright()
    except DamagedTiffError:
        return data
