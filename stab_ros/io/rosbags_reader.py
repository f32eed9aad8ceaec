"""Recordings in sqlite3 or ROS 1 format, through rosbags."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import apsw
from rosbags.convert.converter import LATCH
from rosbags.interfaces import Connection, ConnectionExtRosbag1, MessageDefinitionFormat
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag2 import ReaderError as Reader2Error
from rosbags.rosbag2.metadata import dump_qos_v8
from ruamel.yaml.error import YAMLError

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.io.bag_types import Message, Topic, topic_of
from stab_ros.io.cdr import typestore
from stab_ros.io.compression import UNPACKING_ERRORS, plain_message
from stab_ros.io.mcap_extras import Extra
from stab_ros.io.other_storage import ROS1_SUFFIXES, SQLITE3, remedy_for, storage_of
from stab_ros.io.ros1 import CONVERSION_ERRORS, Conversion, ros1_topic
from stab_ros.io.rosbags_bounds import BoundedReader1, BoundedReader2

# what rosbags lets through on damaged files besides its own errors
_DAMAGE = (
    *CONVERSION_ERRORS, *UNPACKING_ERRORS, Reader1Error, Reader2Error, YAMLError, apsw.Error, OSError)
_SQLITE3_DAMAGE = (apsw.CorruptError, apsw.NotADBError)  # any other: an intact file that is no recording
_UNSUPPORTED = "not supported"  # what rosbags says of bags that are encrypted, or of another version
_SCHEMA_ENCODINGS = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}


class RosbagsReader:
    """A BagReader for a ROS 1 .bag or a .db3.

    Raises:
        InputError: it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        self.topics: dict[str, Topic] = {}
        self._conversions: dict[int, tuple[str, Conversion]] = {}  # by connection id: topic and conversion to CDR
        try:
            self._reader = BoundedReader1(path) if path.name.lower().endswith(ROS1_SUFFIXES) else BoundedReader2(path)
            self._reader.open()
        except _DAMAGE as error:
            raise InputError(f"{path}: cannot be read ({_reason(error)}), {_to_do(path, error)}") from error
        self._check_journal()
        filled = self._reader.message_count > 0
        self.start_ns = self._reader.start_time if filled else 0
        self.end_ns = self._reader.end_time - 1 if filled else 0  # rosbags gives the time after the last message
        for connection in self._reader.connections:
            self._take(connection)

    def _check_journal(self) -> None:
        """A recorder that was killed leaves the last messages in a second file, which is read by writing to both."""
        journal = self.path.with_name(f"{self.path.name}-wal")
        if journal.is_file() and journal.stat().st_size:
            self._warn(f"{journal.name} beside it holds messages that are not read; unite both by sqlite3 "
                       f"{self.path.name} 'pragma wal_checkpoint(truncate)'")

    def close(self) -> None:
        self._reader.close()

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """The messages of `topics` (None: of all) in the order of their log time; what is damaged ends them."""
        wanted = [
            connection for connection in self._reader.connections
            if connection.id in self._conversions and (topics is None or connection.topic in topics)
        ]
        if not wanted:  # rosbags would take that for all
            return
        time_ns = self.start_ns
        try:
            for connection, time_ns, data in self._reader.messages(wanted):
                yield from self._converted(connection.id, time_ns, data)
        except _DAMAGE as error:
            to_do = f"; {remedy_for(self.path, SQLITE3)}" if storage_of(self.path) is SQLITE3 else ""
            self._warn(f"is damaged after {time_ns} ns ({_reason(error)}), what follows is lost{to_do}")

    def extras(self) -> Iterator[Extra]:
        """None: these formats have no such thing."""
        return iter(())

    def _converted(self, connection_id: int, time_ns: int, data: bytes) -> Iterator[Message]:
        topic, to_cdr = self._conversions[connection_id]
        if type(time_ns) is not int or not isinstance(data, (bytes, memoryview)):  # SQLite holds any type anywhere
            self._warn(f"a message of {topic} has no time or no bytes, it is left out")
            return
        try:
            yield Message(topic, time_ns, time_ns, bytes(to_cdr(plain_message(bytes(data)))))
        except _DAMAGE as error:
            self._warn(f"a message of {topic} at {time_ns} ns is damaged ({_reason(error)}), it is left out")

    def _take(self, connection: Connection) -> None:
        try:
            topic, to_cdr = _converted_topic(connection)
        except _DAMAGE as error:
            self._warn(f"{connection.topic} is left out, its definition cannot be read ({_reason(error)})")
            return
        known = self.topics.setdefault(topic.name, replace(topic, count=0))
        if known.msgtype != topic.msgtype:
            self._warn(f"{topic.name} holds {known.msgtype} and {topic.msgtype}, the second type is left out")
            return
        self.topics[topic.name] = replace(known, count=known.count + topic.count)
        self._conversions[connection.id] = topic.name, to_cdr

    def _warn(self, what: str) -> None:
        self.warnings.append(f"{self.path}: {one_line(what)}")


def _converted_topic(connection: Connection) -> tuple[Topic, Conversion]:
    """The topic as ROS 2 has it, and how to get its messages into CDR."""
    if isinstance(connection.ext, ConnectionExtRosbag1):
        qos = dump_qos_v8(LATCH) if connection.ext.latching else ""
        return ros1_topic(Topic(connection.topic, connection.msgtype, connection.msgcount, connection.msgdef.data, qos))
    msgdef, qos = connection.msgdef, dump_qos_v8(connection.ext.offered_qos_profiles)
    name, msgtype, count = connection.topic, connection.msgtype, connection.msgcount
    if msgdef.format in _SCHEMA_ENCODINGS:
        return Topic(name, msgtype, count, msgdef.data, qos, schema_encoding=_SCHEMA_ENCODINGS[msgdef.format],
                     type_hash=connection.digest), bytes
    if msgtype in typestore().fielddefs:  # recordings before Iron hold no definitions
        return replace(topic_of(name, msgtype, qos), count=count), bytes
    return Topic(name, msgtype, count, "", qos, schema_encoding=""), bytes


def _reason(error: BaseException) -> str:
    """The text of an error; rosbags puts the arguments of one, a tuple, into that of another."""
    return re.sub(r"\('(.*)',\)", r"\1", one_line(error)) or type(error).__name__


def _to_do(path: Path, error: BaseException) -> str:
    """What to do about a file that cannot be opened."""
    storage = storage_of(path)
    no_damage = storage is SQLITE3 and not isinstance(error.__cause__ or error, _SQLITE3_DAMAGE)
    if storage is None or no_damage or _UNSUPPORTED in str(error):
        return "it must be a whole recording"
    return f"it {storage.damage}; {remedy_for(path, storage)}"
