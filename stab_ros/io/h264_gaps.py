"""Missing packets of an H.264 stream, by the numbers of its reference pictures (ITU-T H.264, 7.3 and 7.4.3).

FFmpeg fills such a gap with a copy of the picture before it and says nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

_SLICE, _IDR_SLICE, _SPS, _PPS = 1, 5, 7, 8
_HEAD = 512  # bytes of a unit that are looked at: a parameter set is shorter, and so is the part of a slice that counts
_WITH_CHROMA = (44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244)  # profiles
_START = re.compile(b"\0\0\1")


class _Numbering(NamedTuple):
    """Of a sequence parameter set. bits: of a frame number."""

    bits: int
    has_planes: bool
    may_have_gaps: bool


class _Bits:
    """Raises ValueError beyond the end."""

    def __init__(self, data: bytes) -> None:
        self._value, self._left = int.from_bytes(data, "big"), 8 * len(data)

    def take(self, count: int) -> int:
        self._left -= count
        return (self._value >> self._left) & ((1 << count) - 1)  # a negative shift is a ValueError

    def golomb(self) -> int:
        zeros = 0
        while not self.take(1):
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)


class FrameNumbers:
    """Follows the frame numbers of a stream, packet by packet."""

    def __init__(self) -> None:
        self._numberings: dict[int, _Numbering] = {}  # by id of the sequence parameter set
        self._sequences: dict[int, int] = {}  # id of the sequence parameter set by that of the picture parameter set
        self._previous: int | None = None  # of the last reference picture

    def misses_before(self, packet: bytes) -> bool:
        """Whether reference pictures are missing between the last packet and this one; False if that cannot be told."""
        for kind, is_reference, bits in _units(packet):
            try:
                if kind == _SPS:
                    self._take_sequence(bits)
                elif kind == _PPS:
                    picture, sequence = bits.golomb(), bits.golomb()
                    self._sequences[picture] = sequence
                else:
                    return self._is_after_gap(kind, is_reference, bits)
            except (ValueError, KeyError):  # damaged, or its parameter sets have not come yet
                self._previous = None
        return False

    def _is_after_gap(self, kind: int, is_reference: bool, bits: _Bits) -> bool:
        bits.golomb(), bits.golomb()  # first macroblock, slice type
        numbering = self._numberings[self._sequences[bits.golomb()]]
        if numbering.has_planes:
            bits.take(2)
        number, previous = bits.take(numbering.bits), self._previous
        if is_reference:
            self._previous = number
        if kind == _IDR_SLICE or previous is None or numbering.may_have_gaps:
            return False
        return number not in (previous, (previous + 1) % 2**numbering.bits)

    def _take_sequence(self, bits: _Bits) -> None:
        profile = bits.take(8)
        bits.take(16)  # constraints, level
        sequence = bits.golomb()
        has_planes = profile in _WITH_CHROMA and _skip_chroma(bits)
        number_bits = bits.golomb() + 4
        _skip_order(bits)
        bits.golomb()  # reference frames
        self._numberings[sequence] = _Numbering(number_bits, has_planes, bool(bits.take(1)))


def _units(packet: bytes) -> Iterator[tuple[int, bool, _Bits]]:
    """Slices and parameter sets of a packet: type, whether others refer to it, and what follows."""
    for start in _START.finditer(packet):
        unit = packet[start.end() : start.end() + _HEAD]
        kind = unit[0] & 0x1F if unit else 0
        if kind in (_SLICE, _IDR_SLICE, _SPS, _PPS):
            yield kind, bool(unit[0] & 0x60), _Bits(unit[1:].replace(b"\0\0\3", b"\0\0"))


def _skip_chroma(bits: _Bits) -> bool:
    """Returns whether the colour planes are coded one by one."""
    chroma = bits.golomb()
    has_planes = chroma == 3 and bool(bits.take(1))
    bits.golomb(), bits.golomb(), bits.take(1)  # bit depths, lossless
    if bits.take(1):
        for number in range(12 if chroma == 3 else 8):
            if bits.take(1):
                _skip_scaling(bits, 16 if number < 6 else 64)
    return has_planes


def _skip_scaling(bits: _Bits, size: int) -> None:
    scale = 8
    for _ in range(size):
        coded = bits.golomb()
        scale = (scale + (coded + 1) // 2 * (1 if coded % 2 else -1)) % 256
        if scale == 0:
            return


def _skip_order(bits: _Bits) -> None:
    """The parameters of the order in which pictures are shown."""
    kind = bits.golomb()
    if kind == 0:
        bits.golomb()
    elif kind == 1:
        bits.take(1)
        bits.golomb(), bits.golomb()
        for _ in range(min(bits.golomb(), 255)):
            bits.golomb()
