"""A bag that holds the new messages of every picture, and all else of the input byte for byte."""

from __future__ import annotations

from collections.abc import Mapping

from stab_ros.io.bag import BagWriter, Message, topic_of
from stab_ros.io.source import Picture, Source


class OutputBag:
    """Writes new messages at the times of their picture, and copies topics, attachments and metadata of the input.

    An input topic with the name of an output topic is left out (`replaced`). taken_over: names of the topics that are
    copied.

    Raises:
        WorkError: the bag cannot be written (any method).
    """

    def __init__(self, writer: BagWriter, source: Source, types: Mapping[str, str], keep_images: bool) -> None:
        """types: of the output topics, by name. keep_images: whether the image topic of the input is copied."""
        self._writer = writer
        self.taken_over = {name for name in source.topics if name not in types}
        if not keep_images:
            self.taken_over.discard(source.image_topic)
        self.replaced = sorted(name for name in source.topics if name in types)
        for name, msgtype in types.items():
            writer.add_topic(topic_of(name, msgtype))
        for name in sorted(self.taken_over):
            writer.add_topic(source.topics[name])
        writer.add_extras(source.extras())

    def take_over(self, message: Message) -> None:
        """Copies a message of the input, if its topic is one of those."""
        if message.topic in self.taken_over:
            self._writer.write(message.topic, message.log_time_ns, message.publish_time_ns, message.data)

    def write(self, picture: Picture, topic: str, data: bytes) -> None:
        """Writes a new message, with the log time of the picture."""
        self._writer.write(topic, picture.log_time_ns, picture.publish_time_ns, data)
