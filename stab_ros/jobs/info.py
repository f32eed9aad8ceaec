"""The content of an input, as lines of text."""

from __future__ import annotations

import itertools
from contextlib import closing
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

from stab_ros.core.errors import MessageError
from stab_ros.core.text import counted, one_line
from stab_ros.core.types import Frame
from stab_ros.io.bag import BagReader, Topic, open_bag
from stab_ros.io.image_topic import holds_images, stamp_of, video_format
from stab_ros.io.picture_reader import pictures_of
from stab_ros.io.source import Kind, kind_of, open_source
from stab_ros.io.stamp_check import StampCheck
from stab_ros.io.stamp_order import StampOrder
from stab_ros.io.video import VideoFacts, VideoFile

_CHECKED_STAMPS = 50  # images, which are read whole
_MOST_LOST = 600  # images at the beginning of a video, among which there is a key frame


def describe(path: Path) -> tuple[list[str], list[str]]:
    """The lines, and warnings about unreadable parts.

    Raises:
        InputError: the input is missing or unreadable.
    """
    kind = kind_of(path)
    if kind is Kind.VIDEO:
        return _describe_video(path)
    if kind is Kind.FOLDER:
        return _describe_pictures(path)
    with open_bag(path) as reader:
        lines = [f"{path}: {_span(reader)}", *_table(reader), *_images(reader), *_extras(reader)]
        faults = _stamp_faults(path, reader)
        return lines, [*reader.warnings, *faults]


def _describe_pictures(path: Path) -> tuple[list[str], list[str]]:
    with open_source(path) as source:
        first = next(source.frames())
        count = "an unknown number of frames" if source.count is None else counted(source.count, "frame")
        frames = f"{count}, {source.rate_hz():g} frames/s, {_picture(first.decoded)}"
        return [f"{path}: {kind_of(path).value}, {frames}"], source.warnings


def _describe_video(path: Path) -> tuple[list[str], list[str]]:
    with closing(VideoFile(path, None)) as video:
        _, first = next(video.frames())
        facts = video.facts
        frames = f"{counted(facts.pace.frames, 'frame')}, {video.fps:g} frames/s, {_picture(first)}"
        times = f"{facts.pace.duration_s:.3f} s from the first frame to the last; {_times(facts)}"
        cut = [f"{path}: it is cut off after {counted(facts.pace.frames, 'frame')}"] if facts.cut else []
        return [f"{path}: video, {frames}", f"  {facts.codec}, {facts.pixels}, {times}"], [*video.warnings, *cut]


def _times(facts: VideoFacts) -> str:
    if not facts.timed:
        return f"no times in the file, {facts.nominal_fps:g} frames/s are assumed"
    if facts.pace.constant:
        return f"its times keep {facts.nominal_fps:g} frames/s"
    return (f"it names {facts.nominal_fps:g} frames/s, but its times vary: {1e3 * facts.pace.shortest_s:.1f} to "
            f"{1e3 * facts.pace.longest_s:.1f} ms from frame to frame")


def _span(reader: BagReader) -> str:
    count = sum(topic.count for topic in reader.topics.values())
    if not count:
        return "no messages"
    return f"{counted(count, 'message')}, {(reader.end_ns - reader.start_ns) / 1e9:.3f} s, {_utc(reader.start_ns)}"


def _utc(time_ns: int) -> str:
    try:
        return f"from {datetime.fromtimestamp(time_ns / 1e9, timezone.utc):%Y-%m-%d %H:%M:%S} UTC"
    except (OverflowError, ValueError, OSError):
        return f"from {time_ns} ns"


def _table(reader: BagReader) -> list[str]:
    topics = sorted(reader.topics.values(), key=lambda topic: topic.name)
    names = [(one_line(topic.name), one_line(topic.msgtype)) for topic in topics]
    width = max((len(name) for name, _ in names), default=0)
    type_width = max((len(msgtype) for _, msgtype in names), default=0)
    return [f"  {name:{width}}  {msgtype:{type_width}}  {topic.count:6}"
            for (name, msgtype), topic in zip(names, topics, strict=True)]


def _images(reader: BagReader) -> list[str]:
    return [f"  {one_line(topic.name)}: {_first_image(reader, topic)}" for topic in _image_topics(reader)]


def _image_topics(reader: BagReader) -> list[Topic]:
    return [topic for _, topic in sorted(reader.topics.items()) if holds_images(topic)]


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
    return f"{text}, begins {counted(lost, 'image')} before its first key frame" if lost else text


def _extras(reader: BagReader) -> list[str]:
    return [f"  {one_line(extra)}" for extra in reader.extras()]


def _stamp_faults(path: Path, reader: BagReader) -> list[str]:
    """What is wrong with the header stamps of the first images of each topic."""
    faults = {topic.name: _stamp_fault(reader, topic) for topic in _image_topics(reader)}
    return [f"{path}: {one_line(name)}: {fault}" for name, fault in faults.items() if fault]


def _stamp_fault(reader: BagReader, topic: Topic) -> str:
    check, order = StampCheck(), StampOrder([topic.name], partial(stamp_of, topic=topic))
    for message in order.sorted(itertools.islice(reader.messages([topic.name]), _CHECKED_STAMPS)):
        stamp_ns = stamp_of(message.data, topic)
        if stamp_ns is not None:
            check.add(stamp_ns, message.publish_time_ns, message.log_time_ns)
    return check.fault()


def _picture(decoded: Frame | MessageError) -> str:
    if isinstance(decoded, Frame):
        return decoded.kind
    return f"the first image cannot be decoded ({decoded})"
