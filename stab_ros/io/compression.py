"""Compressed parts of recordings, with limits on what they unpack to, against decompression bombs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Protocol

from stab_ros.core.errors import InputError
from stab_ros.io.mcap_records import RECORD_LIMIT, WINDOW_LIMIT

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

UNPACKED_LIMIT = RECORD_LIMIT  # bytes of one message or chunk
FILE_FACTOR = 100  # a compressed file may unpack to UNPACKED_LIMIT, or to so many times its own size
_STEP = 2**20  # bytes that are unpacked at a time
_FILE_STEP = 2**16  # of a file that may be cut short: so many are lost
_WINDOW: dict[int, int] = {zstd.DecompressionParameter.window_log_max: WINDOW_LIMIT.bit_length() - 1}
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # CDR begins with a zero
UNPACKING_ERRORS = (zstd.ZstdError, EOFError, ValueError, MemoryError)


class TooLargeError(ValueError):
    """More would be unpacked than any regular recording holds."""


class _Decompressor(Protocol):
    """What bz2, lz4 and zstd have in common."""

    @property
    def eof(self) -> bool: ...

    @property
    def unused_data(self) -> bytes | None: ...

    def decompress(self, data: bytes, max_length: int) -> bytes: ...


def unpacked(stream: _Decompressor, packed: bytes, limit: int = UNPACKED_LIMIT) -> bytes:
    """The one compressed stream that `packed` is, at most `limit` bytes.

    Raises:
        TooLargeError: it is longer. EOFError, ValueError: it is cut short, or followed by something else.
    """
    found = bytearray()
    piece = stream.decompress(packed, _STEP)
    while piece and len(found) + len(piece) <= limit:
        found += piece
        piece = b"" if stream.eof else stream.decompress(b"", _STEP)
    if piece:
        raise TooLargeError(f"it unpacks to more than {limit} bytes")
    if not stream.eof:
        raise EOFError("its compressed data is cut short")
    if stream.unused_data:
        raise ValueError("its compressed data is followed by something else")
    return bytes(found)


def unpacked_message(packed: bytes) -> bytes:
    """A message of a bag with `compression_mode: message`.

    Raises:
        UNPACKING_ERRORS: it is damaged or too large.
    """
    return unpacked(zstd.ZstdDecompressor(options=_WINDOW), packed)


def plain_message(data: bytes) -> bytes:
    """A message in CDR, whether its bag has `compression_mode: message` or not: only metadata.yaml would say so.

    Raises:
        UNPACKING_ERRORS: as `unpacked_message`.
    """
    return unpacked_message(data) if data.startswith(_ZSTD_MAGIC) else data


def unpack_file(packed: Path, target: Path, room: int) -> str:
    """Unpacks a file of a bag with `compression_mode: file`; gives why its end is lost, "" if it is whole.

    room: bytes that it may take on the disk.

    Raises:
        InputError: it is too large, or cannot be read or written.
    """
    try:
        limit, size = min(room, max(UNPACKED_LIMIT, FILE_FACTOR * packed.stat().st_size)), 0
        with zstd.open(packed, "rb", options=_WINDOW) as file, target.open("wb") as unpacked_file:
            while piece := file.read(_FILE_STEP):
                size += len(piece)
                if size > limit:
                    raise InputError(f"{packed}: unpacks to more than {limit} bytes, it must be a recording")
                unpacked_file.write(piece)
    except UNPACKING_ERRORS as error:
        return f"{error}"
    except OSError as error:
        raise InputError(f"{packed}: cannot be unpacked into {target.parent} ({error.strerror})") from error
    return ""
