"""A recording of several files, sqlite3 or compressed ones among them, as one stream of messages."""

from __future__ import annotations

import heapq
import shutil
import tempfile
from collections.abc import Collection, Iterable, Iterator, Set
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.io.bag_types import Message, Topic, take_topic
from stab_ros.io.compression import unpack_file
from stab_ros.io.mcap_extras import Extra, each_once
from stab_ros.io.ros1_mcap import Ros2McapReader
from stab_ros.io.rosbag2_folder import COMPRESSED
from stab_ros.io.rosbags_reader import RosbagsReader


class _Due(NamedTuple):
    """A message in the order of log time and part; without one it announces its part."""

    time_ns: int
    part: int
    message: Message | None


class SplitReader:
    """A BagReader. Of each part whose time has not come, nothing is in memory.

    Raises:
        InputError: not one of the files can be read.
    """

    def __init__(self, paths: list[Path], warnings: Iterable[str] = ()) -> None:
        self._extra_warnings = list(warnings)
        self.topics: dict[str, Topic] = {}
        with ExitStack() as stack:
            self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            self._source = paths[0].parent
            self._readers = self._opened(paths, stack)
            self._names = [self._take_topics(reader) for reader in self._readers]
            self._stack = stack.pop_all()
        filled = [reader for reader in self._readers if any(topic.count for topic in reader.topics.values())]
        self.start_ns = min((reader.start_ns for reader in filled), default=0)
        self.end_ns = max((reader.end_ns for reader in filled), default=0)

    def close(self) -> None:
        self._stack.close()

    @property
    def warnings(self) -> list[str]:
        """What could not be read, one line each; unpacked files under the names of the compressed ones."""
        lines = [line for reader in self._readers for line in reader.warnings]
        return [*self._extra_warnings, *(self._named(line) for line in lines)]

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """The messages of `topics` (None: of all) in the order of their log time."""
        streams = [
            _in_order(reader, number, wanted)
            for number, (reader, names) in enumerate(zip(self._readers, self._names, strict=True))
            for wanted in [names if topics is None else names & set(topics)] if wanted
        ]
        for due in heapq.merge(*streams, key=lambda due: due[:2]):
            if due.message is not None:
                yield due.message

    def extras(self) -> Iterator[Extra]:
        """Attachments and metadata of all parts; what several hold comes once."""
        return each_once(reader.extras() for reader in self._readers)

    def _opened(self, paths: list[Path], stack: ExitStack) -> list[Ros2McapReader | RosbagsReader]:
        readers: list[Ros2McapReader | RosbagsReader] = []
        room = shutil.disk_usage(self._folder).free // 2
        for path in paths:
            try:
                plain = self._unpacked(path, room) if path.suffix == COMPRESSED else path
                readers.append(Ros2McapReader([plain]) if plain.suffix.lower() == ".mcap" else RosbagsReader(plain))
            except InputError as error:
                if len(paths) == 1:
                    raise
                self._extra_warnings.append(self._named(str(error)))
                continue
            stack.callback(readers[-1].close)
            room -= plain.stat().st_size if path.suffix == COMPRESSED else 0
        if not readers:
            raise InputError(f"{self._source}: not one of its files can be read ({'; '.join(self._extra_warnings)})")
        return readers

    def _named(self, line: str) -> str:
        return line.replace(str(self._folder), str(self._source))

    def _unpacked(self, path: Path, room: int) -> Path:
        plain = self._folder / path.name.removesuffix(COMPRESSED)
        try:
            why = unpack_file(path, plain, room)
        except InputError:
            plain.unlink(missing_ok=True)
            raise
        if why:
            self._extra_warnings.append(f"{path}: {one_line(why)}, what follows is lost")
        return plain

    def _take_topics(self, reader: Ros2McapReader | RosbagsReader) -> Set[str]:
        """Takes the topics of a part over, and gives their names."""
        names = set[str]()
        for topic in reader.topics.values():
            contradiction = take_topic(self.topics, topic)
            if contradiction:
                self._extra_warnings.append(f"{self._source}: {contradiction}")
                continue
            names.add(topic.name)
        return names


def _in_order(reader: Ros2McapReader | RosbagsReader, part: int, topics: Set[str]) -> Iterator[_Due]:
    """First the announcement, so that merging reads a part only once its time has come."""
    yield _Due(reader.start_ns, part, None)
    for message in reader.messages(topics):
        yield _Due(message.log_time_ns, part, message)
