"""The content of an input, as lines of text."""

from __future__ import annotations

import itertools
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Frame
from stab_ros.io.bag import BagReader, Topic, open_bag
from stab_ros.io.cdr import read_stamp
from stab_ros.io.image_message import read_image
from stab_ros.io.source import IMAGE_TYPES, Kind, kind_of, open_source
from stab_ros.io.stamp_check import StampCheck

_CHECKED_STAMPS = 50  # images, which are read whole


def describe(path: Path) -> tuple[list[str], list[str]]:
    """The lines, and warnings about unreadable parts.

    Raises:
        InputError: the input is missing or unreadable.
    """
    if kind_of(path) is not Kind.BAG:
        return _describe_pictures(path)
    with open_bag(path) as reader:
        lines, faults = [f"{path}: {_span(reader)}", *_table(reader), *_images(reader)], _stamp_faults(path, reader)
        return lines, [*reader.warnings, *faults]


def _describe_pictures(path: Path) -> tuple[list[str], list[str]]:
    with open_source(path) as source:
        first = next(source.frames())
        count = "an unknown number of" if source.count is None else source.count
        frames = f"{count} frames, {source.rate_hz():g} frames/s, {_picture(first.decoded)}"
        return [f"{path}: {kind_of(path).value}, {frames}"], source.warnings


def _span(reader: BagReader) -> str:
    count = sum(topic.count for topic in reader.topics.values())
    if not count:
        return "no messages"
    return f"{count} messages, {(reader.end_ns - reader.start_ns) / 1e9:.3f} s, {_utc(reader.start_ns)}"


def _utc(time_ns: int) -> str:
    try:
        return f"from {datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (OverflowError, ValueError, OSError):
        return f"from {time_ns} ns"


def _table(reader: BagReader) -> list[str]:
    topics = sorted(reader.topics.values(), key=lambda topic: topic.name)
    width = max((len(topic.name) for topic in topics), default=0)
    type_width = max((len(topic.msgtype) for topic in topics), default=0)
    return [f"  {topic.name:{width}}  {topic.msgtype:{type_width}}  {topic.count:6}" for topic in topics]


def _images(reader: BagReader) -> list[str]:
    return [f"  {name}: {_first_image(reader, reader.topics[name])}" for name in _image_topics(reader)]


def _image_topics(reader: BagReader) -> list[str]:
    return sorted(topic.name for topic in reader.topics.values() if topic.msgtype in IMAGE_TYPES)


def _first_image(reader: BagReader, topic: Topic) -> str:
    for message in itertools.islice(reader.messages([topic.name]), 1):
        try:
            return _picture(read_image(message.data, topic.msgtype))
        except MessageError as error:
            return _picture(error)
    return "no images"


def _stamp_faults(path: Path, reader: BagReader) -> list[str]:
    """What is wrong with the header stamps of the first images of each topic."""
    faults = {name: _stamp_fault(reader, name) for name in _image_topics(reader)}
    return [f"{path}: {name}: {fault}" for name, fault in faults.items() if fault]


def _stamp_fault(reader: BagReader, topic: str) -> str:
    check = StampCheck()
    for message in itertools.islice(reader.messages([topic]), _CHECKED_STAMPS):
        with suppress(MessageError):
            check.add(read_stamp(message.data), message.publish_time_ns, message.log_time_ns)
    return check.fault()


def _picture(decoded: Frame | MessageError) -> str:
    if isinstance(decoded, Frame):
        return f"{decoded.size[0]}x{decoded.size[1]} {decoded.encoding}"
    return f"the first image cannot be decoded ({decoded})"
