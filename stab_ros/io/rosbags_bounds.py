"""The readers of rosbags, with limits on decompression, against decompression bombs."""

from __future__ import annotations

import bz2
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Protocol
from urllib.parse import quote

import apsw
import lz4.frame
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag1.reader import Chunk, IndexData, decompressors
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import ReaderError as Reader2Error
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from ruamel.yaml import YAML

from stab_ros.io.mcap_records import RECORD_LIMIT, WINDOW_LIMIT

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

UNPACKED_LIMIT = RECORD_LIMIT  # bytes of one message or chunk
FILE_FACTOR = 100  # a compressed file may unpack to UNPACKED_LIMIT, or to so many times its own size
_STEP = 2**20  # bytes that are unpacked at a time
_WINDOW: dict[int, int] = {zstd.DecompressionParameter.window_log_max: WINDOW_LIMIT.bit_length() - 1}


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
    """A message of a rosbag2 folder with `compression_mode: message`."""
    return unpacked(zstd.ZstdDecompressor(options=_WINDOW), packed)


def _bz2(packed: bytes) -> bytes:
    return unpacked(bz2.BZ2Decompressor(), packed)


def _lz4(packed: bytes) -> bytes:
    return unpacked(lz4.frame.LZ4FrameDecompressor(), packed)


# of ROS 1: rosbags' own function, and the bounded one
_BOUNDED: dict[Callable[[bytes], bytes], Callable[[bytes], bytes]] = {
    decompressors["bz2"]: _bz2, decompressors["lz4"]: _lz4}
# of MCAP chunks in rosbag2 folders: rosbags has one table for all its readers
DECOMPRESSORS["lz4"] = lambda packed, size: unpacked(
    lz4.frame.LZ4FrameDecompressor(), packed, min(size, UNPACKED_LIMIT))
DECOMPRESSORS["zstd"] = lambda packed, size: unpacked(
    zstd.ZstdDecompressor(options=_WINDOW), packed, min(size, UNPACKED_LIMIT))


class BoundedReader1(Reader1):
    """Of a ROS 1 .bag."""

    _index_bytes = 0

    def read_chunk(self) -> Chunk:
        """Unpacks it to at most UNPACKED_LIMIT, later."""
        chunk = super().read_chunk()
        return chunk._replace(decompressor=_BOUNDED.get(chunk.decompressor, chunk.decompressor))

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Chunks that share one long index would multiply it."""
        assert self.bio
        start = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._index_bytes += self.bio.tell() - start
        if self._index_bytes > self.path.stat().st_size:
            raise Reader1Error("Bag index is longer than the file.")


class _Sqlite3(Sqlite3Reader):
    """Of a .db3; what its tables compute, such as `zeroblob(1e9)`, is bounded too."""

    def __init__(self, path: Path) -> None:
        super().__init__(Path(quote(str(path))))  # becomes part of a URI, where % ? # mean something else

    def open(self) -> None:
        apsw.connection_hooks.append(_bound)
        try:
            super().open()
        finally:
            apsw.connection_hooks.remove(_bound)


def _bound(connection: apsw.Connection) -> None:
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, UNPACKED_LIMIT)
    connection.config(apsw.SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0)


class _Folder(DirectoryReader):
    """Of a rosbag2 folder. Compressed messages come out as they are recorded, for `unpacked_message`."""

    STORAGE_PLUGINS = MappingProxyType({"mcap": McapReader, "sqlite3": _Sqlite3})

    def open(self) -> None:
        _check_files(Path(str(self.path)))
        super().open()
        self.packed = self.metadata.compression_mode == "message"
        self.metadata = self.metadata._replace(compression_mode=None)


class BoundedReader2(Reader2):
    """Of a rosbag2 folder or a .db3."""

    STORAGE_PLUGINS = MappingProxyType({"dir": _Folder, ".mcap": McapReader, ".db3": _Sqlite3})

    @property
    def packed(self) -> bool:
        """Whether every message is compressed for itself."""
        return isinstance(self.storage, _Folder) and self.storage.packed


def _check_files(folder: Path) -> None:
    """Before rosbags unpacks whole files into the folder for temporary files."""
    metadata = YAML(typ="safe").load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    paths = [folder / PurePath(name).name for name in metadata["relative_file_paths"]]
    for path in paths:
        if path.exists() and not path.is_file():
            raise Reader2Error(f"{path.name!r} is no file")
    if metadata.get("compression_mode", "").lower() == "file":
        free = shutil.disk_usage(tempfile.gettempdir()).free // 2
        for path in paths:
            free -= _unpacked_size(path, free) if path.exists() else 0


def _unpacked_size(path: Path, free: int) -> int:
    """The decompressed size of a file, found by decompressing it without keeping the bytes."""
    limit, size = min(free, max(UNPACKED_LIMIT, FILE_FACTOR * path.stat().st_size)), 0
    with zstd.open(path, "rb") as file:
        while piece := file.read(_STEP):
            size += len(piece)
            if size > limit:
                raise TooLargeError(f"{path.name} unpacks to more than {limit} bytes")
    return size
