"""The readers of rosbags, with limits on decompression, against decompression bombs."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from urllib.parse import quote

import apsw
import lz4.frame
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag1.reader import Chunk, IndexData, decompressors
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from stab_ros.io.compression import UNPACKED_LIMIT, unpacked


def _bz2(packed: bytes) -> bytes:
    return unpacked(bz2.BZ2Decompressor(), packed)


def _lz4(packed: bytes) -> bytes:
    return unpacked(lz4.frame.LZ4FrameDecompressor(), packed)


# of ROS 1: rosbags' own function, and the bounded one
_BOUNDED: dict[Callable[[bytes], bytes], Callable[[bytes], bytes]] = {
    decompressors["bz2"]: _bz2, decompressors["lz4"]: _lz4}

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


class BoundedReader2(Reader2):
    """Of a .db3."""

    STORAGE_PLUGINS = MappingProxyType({".db3": _Sqlite3})
