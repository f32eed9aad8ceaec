"""A bag as a source: the images of one topic decoded, all other messages as they were recorded."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Collection, Iterable, Iterator
from functools import partial
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.text import are, counted
from stab_ros.core.types import Frame
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import BagReader, Extra, Message, Topic
from stab_ros.io.camera_message import read_camera
from stab_ros.io.cdr import CAMERA_INFO, COMPRESSED_IMAGE
from stab_ros.io.frame_reader import DEFAULT_FPS, MAX_FPS
from stab_ros.io.image_message import IMAGE_TYPES
from stab_ros.io.image_topic import holds_images, namespace_of, no_images, restamped, stamp_of, video_format
from stab_ros.io.picture import Clock, Picture, only_pictures, readable
from stab_ros.io.picture_reader import with_pictures
from stab_ros.io.repeated_pictures import RepeatedPictures
from stab_ros.io.stamp_check import StampCheck
from stab_ros.io.stamp_order import StampOrder
from stab_ros.io.topics import (
    CAMERA_INFO_TOPIC,
    DEBUG_IMAGE_TOPIC,
    REFERENCE_IMAGE_TOPIC,
    STATIC_MAP_TOPIC,
    topic_in,
)

# how the names of topics end whose images are no stream
REFERENCE_IMAGE, STATIC_MAP = topic_in("", REFERENCE_IMAGE_TOPIC), topic_in("", STATIC_MAP_TOPIC)
SINGLE_IMAGES = (REFERENCE_IMAGE, STATIC_MAP, topic_in("", DEBUG_IMAGE_TOPIC))
_RATE_FRAMES = 30
_SORTED = (*IMAGE_TYPES, CAMERA_INFO)
_NEVER_VIDEO = {*_SORTED} - {COMPRESSED_IMAGE}
_BY_LOG = "all that depends on time goes by the header stamps, give --time log to go by the log"


class BagSource:
    """A bag: its image topic decoded, all other messages as they were recorded."""

    def __init__(self, path: Path, reader: BagReader, image_topic: str | None, clock: Clock = Clock.HEADER) -> None:
        """clock: the times that images are stamped with."""
        self.name = str(path)
        self.clock = clock
        self._faults: list[str] = []  # of the header stamps
        self.topics = reader.topics
        self.image_topic = _choose_topic(self.name, reader, image_topic)
        self.count: int | None = reader.topics[self.image_topic].count
        self._reader = reader
        self._repeated = RepeatedPictures()

    @property
    def warnings(self) -> list[str]:
        copies = self._repeated.remark()
        told = [f"{self.name}: {self.image_topic}: {copies}"] if copies else []
        return [*self._reader.warnings, *self._faults, *told]

    def items(self, limit: int | None = None, others: Collection[str] | None = None) -> Iterator[Picture | Message]:
        wanted = None if others is None else {self.image_topic, *others}
        self._repeated = RepeatedPictures()
        items = self._repeated.watched(self._in_time(self._reader.messages(wanted), others or (), limit))
        return readable(self.name, self.image_topic, items, lambda: self._reader.warnings)

    def frames(self, limit: int | None = None) -> Iterator[Picture]:
        return only_pictures(self.items(limit, ()))

    def extras(self) -> Iterator[Extra]:
        return self._reader.extras()

    def rate_hz(self) -> float:
        by_log = self.clock is Clock.LOG
        times_ns = (logged_ns if by_log else stamp_ns for stamp_ns, logged_ns in self.logged())
        return _rate_hz(sorted(itertools.islice(times_ns, _RATE_FRAMES)))

    def logged(self) -> Iterator[tuple[int, int]]:
        """Header stamp and log time of each image that has a stamp, ns; of a coded video in the order of its frames."""
        topic = self.topics[self.image_topic]
        is_video = self._is_video(topic)
        arrived, shown = itertools.tee(self._reader.messages([topic.name]))
        order = StampOrder([topic.name] if is_video else [], partial(stamp_of, topic=topic))
        for first, message in zip(arrived, order.sorted(shown), strict=True):
            stamp_ns = stamp_of(message.data, topic)
            if stamp_ns is not None:
                yield stamp_ns, first.log_time_ns

    def camera(self) -> Camera:
        name = topic_in(namespace_of(self.topics[self.image_topic]), CAMERA_INFO_TOPIC)
        topic = self.topics.get(name)
        if topic is None or topic.msgtype != CAMERA_INFO:
            raise InputError(f"{self.name}: use_camera_info needs a topic {name} of type {CAMERA_INFO}, there is none")
        for message in self._reader.messages([name]):
            return self._fitting(name, message)
        raise InputError(f"{self.name}: use_camera_info needs a message on {name}, there is none")

    def _fitting(self, name: str, message: Message) -> Camera:
        """The camera in a message of topic `name`, which must have the size of the first readable image."""
        try:
            camera = read_camera(message.data)
        except InputError as error:
            raise InputError(f"{self.name}: {name} cannot be used: {error}") from error
        sizes = (picture.decoded.size for picture in self.frames() if isinstance(picture.decoded, Frame))
        size = next(sizes, camera.size)
        if size != camera.size:
            raise InputError("{}: {} is for {}x{} px, the images of {} have {}x{}; it must be of the same size".format(
                self.name, name, *camera.size, self.image_topic, *size))
        return camera

    def _in_time(self, messages: Iterable[Message], others: Collection[str],
                  limit: int | None) -> Iterator[Picture | Message]:
        """The items up to the limit, stamped by the clock and in its order.

        others: topics to be sorted beside the images. At the end it is known whether the header stamps are fit.
        """
        check, by_log = StampCheck(), self.clock is Clock.LOG
        order = StampOrder([] if by_log else [name for name in (self.image_topic, *others) if self._can_sort(name)])
        in_order = order.sorted(self._first(messages, limit))
        restamp = partial(restamped, topic=self.topics[self.image_topic])
        for item in with_pictures(in_order, self.topics[self.image_topic]):
            if isinstance(item, Picture) and isinstance(item.decoded, Frame):  # lost ones of a video are in no order
                check.add(item.stamp_ns, item.publish_time_ns, item.log_time_ns)
            yield item.stamped_as_logged(restamp) if by_log and isinstance(item, Picture) else item
        self._faults = [] if by_log else self._told(check.fault(), order.late.get(self.image_topic, 0))

    def _can_sort(self, name: str) -> bool:
        """Not a coded video: each of its frames needs the one that was logged before it."""
        topic = self.topics.get(name)
        return topic is not None and topic.msgtype in _SORTED and not self._is_video(topic)

    def _is_video(self, topic: Topic) -> bool:
        if topic.msgtype in _NEVER_VIDEO:
            return False
        first = next(self._reader.messages([topic.name]), None)
        return first is not None and bool(video_format(first.data, topic))

    def _first(self, messages: Iterable[Message], limit: int | None) -> Iterator[Message]:
        """The messages up to and without image number `limit`."""
        images = 0
        for message in messages:
            images += message.topic == self.image_topic
            if limit is not None and images > limit:
                return
            yield message

    def _told(self, fault: str, late: int) -> list[str]:
        told = [f"{self.name}: {self.image_topic}: {fault}; {_BY_LOG}"] if fault else []
        if not late:
            return told
        return [*told, f"{self.name}: {counted(late, 'image')} of {self.image_topic} {are(late)} logged out of order, "
                "all are taken in the order of their header stamps, give --time log to go by the log"]


def _choose_topic(name: str, reader: BagReader, wanted: str | None) -> str:
    topics = reader.topics
    images = sorted(topic.name for topic in topics.values() if holds_images(topic))
    if not images:
        raise no_images(name, topics, reader.warnings)
    if wanted is not None and wanted not in images:
        raise InputError(f"{name}: has no image topic {wanted}; its image topics are {', '.join(images)}")
    filled = [topic for topic in images if topics[topic].count > 0 and not topic.endswith(SINGLE_IMAGES)]
    if wanted is None and len(filled) > 1:
        raise InputError(f"{name}: has several image topics, name one with --image-topic: {', '.join(filled)}")
    return wanted or (filled or images)[0]


def _rate_hz(stamps_ns: list[int]) -> float:
    steps = [after - before for before, after in itertools.pairwise(stamps_ns) if after > before]
    rate = 1e9 / statistics.median(steps) if steps else DEFAULT_FPS
    return rate if 0 < rate <= MAX_FPS else DEFAULT_FPS
