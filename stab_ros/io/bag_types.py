"""The content of a recording, independent of its format."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.io.cdr import typestore
from stab_ros.io.mcap_extras import Extra


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    definition: ros2msg text with its dependencies, "" if unknown (bytes that are not UTF-8 as surrogate escapes).
    qos: offered_qos_profiles as YAML, "" if unknown. encoding: of the messages; schema_encoding: of the definition.
    type_hash: RIHS01 of the type, "" if unknown. notes: what else an MCAP file says of it, names and values.
    """

    name: str
    msgtype: str
    count: int
    definition: str
    qos: str = ""
    encoding: str = "cdr"
    schema_encoding: str = "ros2msg"
    type_hash: str = ""
    notes: tuple[tuple[str, str], ...] = ()


class Message(NamedTuple):
    """A recorded message, in CDR (ROS 1 messages have been converted)."""

    topic: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class BagReader(Protocol):
    """A recording, open for reading from one thread.

    start_ns, end_ns: log times of the first and the last message, 0 without messages.
    warnings: what could not be read, one line each; complete once `messages` has come to its end.
    """

    @property
    def topics(self) -> Mapping[str, Topic]: ...

    @property
    def start_ns(self) -> int: ...

    @property
    def end_ns(self) -> int: ...

    @property
    def warnings(self) -> list[str]: ...

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """The messages of `topics` (None: of all) in the order of their log time."""

    def extras(self) -> Iterator[Extra]:
        """Attachments and metadata of an MCAP recording; none in other formats."""


def take_topic(topics: dict[str, Topic], topic: Topic) -> str:
    """Adds a topic of one more channel or file to those of its recording, and its messages to their number.

    Returns:
        Why it is left out, in one line; an empty string where it is not.
    """
    known = topics.get(topic.name, replace(topic, count=0))
    if (known.msgtype, known.encoding) != (topic.msgtype, topic.encoding):
        what = one_line(f"{topic.name} holds {known.msgtype} and {topic.msgtype}")
        return f"{what}, the messages of the second type are left out"
    topics[topic.name] = replace(known, count=known.count + topic.count)
    return ""


def definition_of(msgtype: str) -> str:
    """The definition of a message type of ROS 2 Jazzy with its dependencies, as ros2msg text.

    Raises:
        InputError: the type is unknown.
    """
    _check_known(msgtype)
    return typestore().generate_msgdef(msgtype, ros_version=2)[0]


def topic_of(name: str, msgtype: str, qos: str = "") -> Topic:
    """A new topic of a message type of ROS 2 Jazzy.

    Raises:
        InputError: the type is unknown.
    """
    return Topic(name, msgtype, 0, definition_of(msgtype), qos, type_hash=typestore().hash_rihs01(msgtype))


def _check_known(msgtype: str) -> None:
    if msgtype not in typestore().fielddefs:
        raise InputError(f"message type {msgtype!r} is unknown, it must be one of common_interfaces as pkg/msg/Name")
