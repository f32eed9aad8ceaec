"""An MCAP recording of one or several files (splits) as one stream of messages."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from stab_ros.core.errors import InputError
from stab_ros.core.text import counted, one_line
from stab_ros.io.bag_types import Message, Topic, take_topic
from stab_ros.io.compression import UNPACKING_ERRORS, plain_message
from stab_ros.io.mcap_contents import QOS_KEY, TYPE_HASH_KEY, Block, McapContents
from stab_ros.io.mcap_extras import Extra, each_once
from stab_ros.io.mcap_file import McapFile
from stab_ros.io.mcap_records import RecordedMessage

_BEFORE_ALL = -1


class _Due(NamedTuple):
    """A message in the order of log time, file, place in the file; without one it announces its block."""

    time_ns: int
    file_number: int
    offset: int
    place: int
    message: RecordedMessage | None


class McapReader:
    """A BagReader. In memory are only the blocks that overlap in log time.

    Raises:
        InputError: not one of the files is a readable MCAP file.
    """

    def __init__(self, paths: list[Path], warnings: Iterable[str] = ()) -> None:
        self._extra_warnings = list(warnings)
        self._files = self._opened(paths)
        spans = [file.contents.span_ns for file in self._files if file.contents.span_ns is not None]
        self.start_ns = min((start_ns for start_ns, _ in spans), default=0)
        self.end_ns = max((end_ns for _, end_ns in spans), default=0)
        self.topics: dict[str, Topic] = {}
        self._names = [self._take_topics(file) for file in self._files]  # per file: topic by channel id

    def close(self) -> None:
        for file in self._files:
            file.close()

    def _opened(self, paths: list[Path]) -> list[McapFile]:
        files = []
        for path in paths:
            try:
                files.append(McapFile(path))
            except InputError as error:
                if len(paths) == 1:
                    raise
                self._extra_warnings.append(str(error))
        if not files:
            raise InputError(self._extra_warnings[-1])
        return files

    @property
    def warnings(self) -> list[str]:
        """What could not be read, one line each."""
        return [*self._extra_warnings, *(line for file in self._files for line in file.warnings)]

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """The messages of `topics` (None: of all) in the order of their log time."""
        streams = [
            _in_order(file, number, block, wanted)
            for number, (file, names) in enumerate(zip(self._files, self._names, strict=True))
            for wanted in [{cid for cid, name in names.items() if topics is None or name in topics}]
            for block in file.contents.blocks
            if not block.channel_ids or block.channel_ids & wanted
        ]
        for due in heapq.merge(*streams):
            if due.message is not None:
                yield from self._plain(self._names[due.file_number][due.message.channel_id], due.message)

    def _plain(self, topic: str, message: RecordedMessage) -> Iterator[Message]:
        try:
            data = plain_message(message.data) if self.topics[topic].encoding == "cdr" else message.data
        except UNPACKING_ERRORS as error:
            what = one_line(f"a message of {topic} at {message.log_time_ns} ns is damaged ({error})")
            self._extra_warnings.append(f"{self._files[0].path}: {what}, it is left out")
            return
        yield Message(topic, message.log_time_ns, message.publish_time_ns, data)

    def extras(self) -> Iterator[Extra]:
        """Attachments and metadata of all files; what several files hold comes once."""
        return each_once(file.extras() for file in self._files)

    def _take_topics(self, file: McapFile) -> dict[int, str]:
        names: dict[int, str] = {}
        for channel_id in sorted(file.contents.channels):
            topic = _topic_of(file.contents, channel_id)
            contradiction = take_topic(self.topics, topic)
            if contradiction:
                self._extra_warnings.append(f"{file.path}: {contradiction}")
                continue
            names[channel_id] = topic.name
        counts, channels = file.contents.counts, file.contents.channels
        nameless = sum(counts[channel_id] for channel_id in counts.keys() - channels.keys())
        if nameless:
            messages = counted(nameless, "message of unknown topic is", "messages of unknown topic are")
            self._extra_warnings.append(f"{file.path}: {messages} left out")
        return names


def _topic_of(contents: McapContents, channel_id: int) -> Topic:
    channel = contents.channels[channel_id]
    schema = contents.schemas.get(channel.schema_id)
    return Topic(
        name=channel.topic,
        msgtype="" if schema is None else schema.name,
        count=contents.counts[channel_id],
        definition="" if schema is None else schema.data.decode(errors="surrogateescape"),
        qos=channel.metadata.get(QOS_KEY, ""),
        encoding=channel.message_encoding,
        schema_encoding="" if schema is None else schema.encoding,
        type_hash=channel.metadata.get(TYPE_HASH_KEY, ""),
        notes=tuple((key, value) for key, value in channel.metadata.items() if key not in (QOS_KEY, TYPE_HASH_KEY)),
    )


def _in_order(file: McapFile, number: int, block: Block, wanted: set[int]) -> Iterator[_Due]:
    """First the announcement, so that merging reads a block only once its time has come."""
    yield _Due(block.start_ns, number, block.offset, _BEFORE_ALL, None)
    for place, message in enumerate(file.messages_of(block)):
        if message.channel_id in wanted:
            yield _Due(message.log_time_ns, number, block.offset, place, message)
