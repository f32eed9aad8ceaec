"""The messages of one image topic as pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Frame
from stab_ros.io.bag_types import Message, Topic
from stab_ros.io.image_topic import read_content, stamp_of
from stab_ros.io.picture import Picture
from stab_ros.io.video_pictures import VideoPictures


def pictures_of(messages: Iterable[Message], topic: Topic) -> Iterator[Picture]:
    """One picture for each message of an image topic. A coded video is decoded from the first message on."""
    return (item for item in with_pictures(messages, topic) if isinstance(item, Picture))


def with_pictures(messages: Iterable[Message], topic: Topic) -> Iterator[Picture | Message]:
    """The messages of a recording, those of an image topic as pictures.

    Where a coded video holds pictures back, other messages do not wait for them.
    """
    video = VideoPictures()
    for message in messages:
        if message.topic == topic.name:
            yield from _pictures(message, topic, video)
        else:
            yield message
    yield from video.finish()


def _pictures(message: Message, topic: Topic, video: VideoPictures) -> Iterator[Picture]:
    """The pictures that are known once a message has come; of a coded video it may be none or several."""
    try:
        content = read_content(message.data, topic)
    except MessageError as error:
        stamp_ns = stamp_of(message.data, topic)
        yield from video.skip(message, message.log_time_ns if stamp_ns is None else stamp_ns, error)
        return
    if isinstance(content, Frame):
        yield Picture(message.log_time_ns, message.publish_time_ns, content.stamp_ns, content, message.data)
    else:
        yield from video.take(message, content)
