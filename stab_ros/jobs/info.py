"""The content of an input, as lines of text."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime
from pathlib import Path

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Frame
from stab_ros.io.bag import BagReader, Topic, open_bag
from stab_ros.io.image_topic import holds_images, video_format
from stab_ros.io.picture_reader import pictures_of
from stab_ros.io.source import Kind, kind_of, open_source

_MOST_LOST = 600  # images at the beginning of a video, among which there is a key frame


def describe(path: Path) -> tuple[list[str], list[str]]:
    """The lines, and warnings about unreadable parts.

    Raises:
        InputError: the input is missing or unreadable.
    """
    if kind_of(path) is not Kind.BAG:
        return _describe_pictures(path)
    with open_bag(path) as reader:
        return [f"{path}: {_span(reader)}", *_table(reader), *_images(reader)], reader.warnings


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
    topics = [topic for topic in reader.topics.values() if holds_images(topic)]
    return [f"  {topic.name}: {_first_image(reader, topic)}" for topic in sorted(topics, key=lambda topic: topic.name)]


def _first_image(reader: BagReader, topic: Topic) -> str:
    """The first image; of a coded video the first that can be decoded, as a recording may begin between key frames."""
    messages = reader.messages([topic.name])
    first = next(messages, None)
    if first is None:
        return "no images"
    video = video_format(first.data, topic)
    pictures = itertools.islice(pictures_of(itertools.chain([first], messages), topic), _MOST_LOST if video else 1)
    lost: list[MessageError] = []
    for picture in pictures:
        if isinstance(picture.decoded, Frame):
            return _picture(picture.decoded) + _coding(video, len(lost))
        lost.append(picture.decoded)
    return _picture(lost[0])


def _coding(video: str, lost: int) -> str:
    text = f", coded as {video}" if video else ""
    return f"{text}, begins {lost} images before its first key frame" if lost else text


def _picture(decoded: Frame | MessageError) -> str:
    if isinstance(decoded, Frame):
        return decoded.kind
    return f"the first image cannot be decoded ({decoded})"
