"""Writes a recording as MCAP with the ros2 profile, so that `ros2 bag`, rosbags and mcap read it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import IO, cast

from mcap.data_stream import RecordBuilder
from mcap.records import AttachmentIndex, DataEnd, Footer, MetadataIndex
from mcap.writer import CompressionType, Writer

from stab_ros.core.errors import InputError, WorkError
from stab_ros.io.bag_types import Topic
from stab_ros.io.mcap_contents import QOS_KEY, TYPE_HASH_KEY
from stab_ros.io.mcap_extras import Extra
from stab_ros.io.mcap_records import MAGIC
from stab_ros.io.mcap_summary import end_with_extras
from stab_ros.io.output_path import final_path

_CHUNK_BYTES = 2**20  # a chunk is closed once it holds more: each image is its own chunk
_CHUNK_SECONDS = 1.0  # a killed recorder loses no more than this
_NEVER = 2**62  # chunks are closed here, not by the library
_TIME_END = 2**64


class BagWriter:
    """Writes `path`.partial, which becomes `path` when the context is left without an error.

    option: by which the user overwrites it, for the error.
    An InputError on the way removes it: nothing is left behind. Any other error keeps it, closed and readable.

    Raises:
        InputError: `path` exists and `overwrite` is false, or cannot be written.
        WorkError: writing failed half way, the disk is full.
    """

    def __init__(self, path: Path, overwrite: bool = False, option: str = "--force") -> None:
        self.path = path = final_path(path)
        self.partial = path.parent / f"{path.name}.partial"
        self._channels: dict[str, int] = {}
        self._topics: dict[str, Topic] = {}
        self._schemas: dict[tuple[str, str, str], int] = {}
        self._extras: list[AttachmentIndex | MetadataIndex] = []
        self._pending_bytes = 0
        self._chunk_since = time.monotonic()
        self._file = _open(path, self.partial, overwrite, option)
        self._intact_end = 0
        # Not compressed: on camera images lz4 saves 0 to 23 % and takes 0.6 to 2.4 ms/MB, zstd 7 to 40 % and 1.5 to
        # 7 ms/MB, where writing takes 0.3 to 1 ms/MB: a 4K frame would cost a third of its time at 25 Hz.
        self._stream = _UnbufferedFile(self._file)
        stream = cast(IO[bytes], self._stream)  # has the three methods that Writer uses
        self._writer = Writer(stream, chunk_size=_NEVER, compression=CompressionType.NONE)
        self._start()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        elif issubclass(kind, InputError):
            self._file.close()
            self.partial.unlink(missing_ok=True)
        elif not self._file.closed:
            self._finish()

    def add_topic(self, topic: Topic) -> None:
        """Announces a topic, which stays even without messages.

        Raises:
            InputError: the topic was announced with another type before.
        """
        known = self._topics.setdefault(topic.name, topic)
        if (known.msgtype, known.encoding) != (topic.msgtype, topic.encoding):
            raise InputError(f"{self.path}: topic {topic.name} is {known.msgtype}, it cannot also be {topic.msgtype}")
        if topic.name not in self._channels:
            metadata = {QOS_KEY: topic.qos, **dict(topic.notes)}
            if topic.type_hash:
                metadata[TYPE_HASH_KEY] = topic.type_hash
            self._channels[topic.name] = self._writer.register_channel(
                topic.name, topic.encoding, self._schema_of(topic), metadata)

    def write(self, topic: str, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Writes a message of a topic that was announced.

        Raises:
            InputError: a time is negative or beyond 64 bits.
            WorkError: the disk is full or gone.
        """
        if not (0 <= log_time_ns < _TIME_END and 0 <= publish_time_ns < _TIME_END):
            raise InputError(f"{self.path}: a message of {topic} has a time that does not fit 64 bits")
        self._writer.add_message(self._channels[topic], log_time_ns, data, publish_time_ns)
        self._pending_bytes += len(data)
        if self._pending_bytes > _CHUNK_BYTES or time.monotonic() - self._chunk_since > _CHUNK_SECONDS:
            self.flush_chunk()

    def add_extras(self, extras: Iterable[Extra]) -> None:
        """Copies attachments and metadata, however large.

        Raises:
            WorkError: the disk is full or gone.
        """
        for extra in extras:
            self.flush_chunk()
            index = replace(extra.index, offset=self._intact_end)
            try:
                for piece in extra.pieces():
                    self._stream.write(piece)
            except OSError as error:
                raise self._broken(error) from error
            self._intact_end = self._file.tell()
            self._extras.append(index)

    def flush_chunk(self) -> None:
        """Closes the chunk: what was written so far survives the end of this process.

        Raises:
            WorkError: the disk is full or gone.
        """
        try:
            self._writer.flush()
        except OSError as error:
            raise self._broken(error) from error
        self._check_not_moved()
        self._intact_end = self._file.tell()
        self._pending_bytes = 0
        self._chunk_since = time.monotonic()

    def close(self) -> None:
        """Completes the file and gives it its final name; does nothing where writing has ended before.

        Raises:
            WorkError: the disk is full or gone.
        """
        if self._file.closed:
            return
        self._finish()
        try:
            self.partial.replace(self.path)
        except OSError as error:
            raise WorkError(f"{self.path}: {error.strerror}, the recording is in {self.partial}") from error

    def _start(self) -> None:
        try:
            self._writer.start(profile="ros2", library="stab_ros")
        except OSError as error:
            self._file.close()
            self.partial.unlink(missing_ok=True)
            raise WorkError(f"{self.path}: cannot be written: {error.strerror}") from error
        self._intact_end = self._file.tell()

    def _schema_of(self, topic: Topic) -> int:
        """The id of the topic's definition; 0 stands for none."""
        key = (topic.msgtype, topic.schema_encoding, topic.definition)
        if not topic.msgtype:
            return 0
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                topic.msgtype, topic.schema_encoding, topic.definition.encode(errors="surrogateescape"))
        return self._schemas[key]

    def _finish(self) -> None:
        self.flush_chunk()
        try:
            self._writer.finish()
            if self._extras:
                self._list_extras()
            self._file.close()
        except OSError as error:
            raise self._broken(error) from error

    def _list_extras(self) -> None:
        """The library would index only attachments that it has held in memory as a whole."""
        self._file.seek(self._intact_end)
        end = self._file.readall()
        self._file.seek(self._intact_end)
        self._stream.write(end_with_extras(end, self._intact_end, self._extras))

    def _check_not_moved(self) -> None:
        """A file that was deleted or moved meanwhile still accepts all bytes, without an error."""
        try:
            in_place = os.path.samestat(self.partial.stat(), os.fstat(self._file.fileno()))
        except OSError:
            in_place = False
        if not in_place:
            self._intact_end = self._file.tell()
            self._cut_back()  # so that the moved file is whole
            raise WorkError(f"{self.partial}: was deleted or moved while it was written, what it held went with it; "
                            "the folder of a recording must stay")

    def _broken(self, error: OSError) -> WorkError:
        self._cut_back()
        return WorkError(f"{self.path}: {error.strerror}, what was written so far is in {self.partial}")

    def _cut_back(self) -> None:
        """Cuts the file back to the last whole chunk and closes it there, so that any reader takes it."""
        tail = RecordBuilder()
        DataEnd(data_section_crc=0).write(tail)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(tail)
        with suppress(OSError), self._file:  # the disk may be gone for good; then whole chunks stay without a tail
            self._file.truncate(self._intact_end)
            self._file.seek(self._intact_end)
            self._file.write(tail.end() + MAGIC)


class _UnbufferedFile:
    """Unbuffered, so that a full disk is reported at once and no bytes are written later."""

    def __init__(self, file: FileIO) -> None:
        self._file = file

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
        return len(data)

    def tell(self) -> int:
        return self._file.tell()

    def flush(self) -> None:
        """Nothing is buffered."""


def _open(path: Path, partial: Path, overwrite: bool, option: str) -> FileIO:
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder, the output must be an .mcap file")
        for taken in (path, partial):
            if taken.exists() and not overwrite:
                raise InputError(f"{taken}: exists already, choose another name or overwrite it with {option}")
        return FileIO(partial, "wb+" if overwrite else "xb+")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}; it must lie in a folder that can be") from error
