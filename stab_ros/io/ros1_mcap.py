"""MCAP recordings whose messages are those of ROS 1, as its bags become when they are converted to MCAP."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from rosbags.typesys.msg import normalize_msgtype

from stab_ros.core.text import one_line
from stab_ros.io.bag_types import Message, Topic
from stab_ros.io.mcap_reader import McapReader
from stab_ros.io.ros1 import CONVERSION_ERRORS, Conversion, ros1_topic

ROS1 = "ros1"  # the encoding of messages


class Ros2McapReader(McapReader):
    """An McapReader that gives messages of ROS 1 in CDR, as ROS 2 has them.

    Raises:
        InputError: not one of the files is a readable MCAP file.
    """

    def __init__(self, paths: list[Path], warnings: Iterable[str] = ()) -> None:
        super().__init__(paths, warnings)
        self._path = paths[0] if len(paths) == 1 else paths[0].parent
        self._left_out: dict[str, None] = {}  # warnings, a set in order
        self._to_cdr: dict[str, Conversion] = {}
        for topic in [topic for topic in self.topics.values() if topic.encoding == ROS1]:
            self._convert(topic)

    @property
    def warnings(self) -> list[str]:
        return [*super().warnings, *self._left_out]

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        for message in super().messages(self.topics if topics is None else topics):
            to_cdr = self._to_cdr.get(message.topic)
            if to_cdr is None:
                yield message
                continue
            try:
                yield message._replace(data=bytes(to_cdr(message.data)))
            except CONVERSION_ERRORS as error:
                self._warn(f"a message of {message.topic} at {message.log_time_ns} ns is damaged "
                           f"({error or type(error).__name__}), it is left out")

    def _convert(self, topic: Topic) -> None:
        try:
            self.topics[topic.name], self._to_cdr[topic.name] = ros1_topic(
                Topic(topic.name, normalize_msgtype(topic.msgtype), topic.count, topic.definition))
        except CONVERSION_ERRORS as error:
            del self.topics[topic.name]
            self._warn(f"{topic.name} is left out, its definition cannot be read ({error or type(error).__name__})")

    def _warn(self, what: str) -> None:
        self._left_out[f"{self._path}: {one_line(what)}"] = None
