"""The output bag of velocimetry: the messages of every interval, and the copied messages of the input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.bag import BagWriter, Message
from stab_ros.io.cdr import MARKER_ARRAY, NAV_SAT_FIX, POINT_CLOUD2
from stab_ros.io.georeference_messages import origin_of_map_cdr
from stab_ros.io.source import Picture, Source, namespace_of
from stab_ros.io.topics import (
    MARKERS_TOPIC,
    ORIGIN_TOPIC,
    VELOCIMETRY_NAME,
    VELOCITY_GRID_TOPIC,
    VELOCITY_TOPIC,
    topic_in,
)
from stab_ros.jobs.output_bag import OutputBag
from stab_ros.jobs.velocity_messages import IntervalMessages
from stab_ros.velocimetry.velocimeter import Measured


@dataclass(frozen=True)
class VelocityTopics:
    """The output topics of one camera."""

    velocity: str
    grid: str
    markers: str
    origin: str

    @staticmethod
    def of(namespace: str) -> VelocityTopics:
        """The topics that a velocimetry_node in this namespace publishes."""
        node = topic_in(namespace, VELOCIMETRY_NAME)
        return VelocityTopics(topic_in(namespace, VELOCITY_TOPIC), topic_in(namespace, VELOCITY_GRID_TOPIC),
                              topic_in(node, MARKERS_TOPIC), topic_in(node, ORIGIN_TOPIC))

    @property
    def types(self) -> Mapping[str, str]:
        return {self.velocity: POINT_CLOUD2, self.grid: POINT_CLOUD2, self.markers: MARKER_ARRAY,
                self.origin: NAV_SAT_FIX}


class VelocityBag:
    """Writes what is told of every interval, and copies all else of the input byte for byte, but for its images.

    An input topic with the name of an output topic is left out (`replaced`).

    Raises:
        WorkError: the bag cannot be written (any method).
    """

    def __init__(self, writer: BagWriter, source: Source) -> None:
        self._names = VelocityTopics.of(namespace_of(source.topics[source.image_topic]))
        self._bag = OutputBag(writer, source, self._names.types, keep_images=False)
        self._origin_written = False

    @property
    def replaced(self) -> list[str]:
        return self._bag.replaced

    def take_over(self, message: Message) -> None:
        self._bag.take_over(message)

    def write_once(self, picture: Picture, measured: Measured, origin: LocalFrame | None) -> None:
        """Writes the origin of the map with the first interval, where it is known."""
        if origin is not None and not self._origin_written:
            self._origin_written = True
            self._bag.write(picture, self._names.origin, origin_of_map_cdr(measured.stamp_ns, origin))

    def write(self, picture: Picture, messages: IntervalMessages) -> None:
        """Writes the messages of an interval, with the log time of the picture that ended it."""
        self._bag.write(picture, self._names.velocity, messages.velocity)
        self._bag.write(picture, self._names.grid, messages.grid)
        self._bag.write(picture, self._names.markers, messages.markers)
