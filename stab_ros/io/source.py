"""One way to read every input: a bag, a video file or a folder of images is a stream of pictures and other messages."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import BagReader, Message, Topic, open_bag, topic_of
from stab_ros.io.messages import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, read_camera, read_image, read_stamp
from stab_ros.io.video import (
    DEFAULT_FPS,
    IMAGE_SUFFIXES,
    MAX_FPS,
    VIDEO_SUFFIXES,
    Decoded,
    ImageFolder,
    Pictures,
    VideoFile,
    image_files,
)

IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE)
REFERENCE_IMAGE, STATIC_MAP = "/reference_image", "/static_map"
SINGLE_IMAGES = (REFERENCE_IMAGE, STATIC_MAP, "/debug_image")  # how topics end that hold pictures, but no stream
PICTURE_TOPIC = "/camera/image_raw"
_BAG_SUFFIXES = (".mcap", ".mcap.partial", ".bag", ".db3")
_RATE_FRAMES = 30
_KINDS = "an .mcap, a rosbag2 folder, a ROS 1 .bag, a video file or a folder of images"


class Kind(Enum):
    """What an input is."""

    BAG = "bag"
    VIDEO = "video"
    FOLDER = "folder of images"


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of the stream. decoded: its frame, or why there is none. data: the recorded message (CDR), if any."""

    log_time_ns: int
    publish_time_ns: int
    stamp_ns: int
    decoded: Decoded
    data: bytes | None = None


class Source(Protocol):
    """A stream to stabilise: the pictures of `image_topic` among all other messages, in the order they were logged.

    count: number of pictures, None where the input does not say. topics: all topics, `image_topic` among them.
    warnings: what could not be read, complete once `items` has come to its end.
    """

    name: str
    image_topic: str
    count: int | None

    @property
    def topics(self) -> Mapping[str, Topic]: ...

    @property
    def warnings(self) -> list[str]: ...

    def items(self, limit: int | None = None, others: Collection[str] | None = None) -> Iterator[Picture | Message]:
        """Everything, up to `limit` pictures; of the other topics only `others`, if given.

        Raises:
            InputError: at the end, if not one picture could be decoded.
        """

    def frames(self, limit: int | None = None) -> Iterator[Picture]:
        """The pictures alone, as `items`."""

    def rate_hz(self) -> float:
        """Frames per second, from the stamps."""

    def camera(self) -> Camera:
        """The camera that took the pictures. Raises InputError where the input does not say, or says another size."""


@contextmanager
def open_source(path: Path, image_topic: str | None = None, fps: float | None = None) -> Iterator[Source]:
    """Opens any input. `fps` counts for videos and folders; `image_topic` may be left out where there is only one.

    Raises:
        InputError: the input is missing, is none of the kinds we read, or has no such image topic.
    """
    kind = kind_of(path)
    if kind is Kind.BAG:
        with open_bag(path) as reader:
            yield BagSource(path, reader, image_topic)
    else:
        if image_topic not in (None, PICTURE_TOPIC):
            raise InputError(f"{path}: a {kind.value} has no topic {image_topic}, its one topic is {PICTURE_TOPIC}")
        with closing(VideoFile(path, fps) if kind is Kind.VIDEO else ImageFolder(path, fps)) as pictures:
            yield PictureSource(path, pictures)


def read_again(path: Path, image_topic: str | None, fps: float | None, limit: int | None,
               number: int) -> Generator[Picture, None, None]:
    """The pictures of an input that is open already once more, of the first `limit` those from `number` on."""
    with open_source(path, image_topic, fps) as source:
        yield from itertools.islice(source.frames(limit), number, None)


def kind_of(path: Path) -> Kind:
    """Decided by name and by what a folder holds.

    Raises:
        InputError: no such file, or none of the kinds we read.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; the input must be {_KINDS}")
    if path.is_dir():
        return _kind_of_folder(path)
    name = path.name.lower()
    if name.endswith(_BAG_SUFFIXES):
        return Kind.BAG
    if name.endswith(VIDEO_SUFFIXES):
        return Kind.VIDEO
    hint = "; for images give their folder" if name.endswith(IMAGE_SUFFIXES) else ""
    raise InputError(f"{path}: cannot be read, the input must be {_KINDS}{hint}")


def _kind_of_folder(path: Path) -> Kind:
    try:
        if (path / "metadata.yaml").exists():
            return Kind.BAG
        if image_files(path):
            return Kind.FOLDER
        if any(path.glob("*.mcap")):  # a killed recorder leaves no metadata.yaml
            return Kind.BAG
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; the input must be {_KINDS}") from error
    raise InputError(f"{path}: holds neither a bag (metadata.yaml, .mcap) nor images ({', '.join(IMAGE_SUFFIXES)})")


def namespace_of(topic: Topic) -> str:
    """The camera's namespace: `/ns` for `/ns/image_raw`, `/ns/image_raw/compressed` and any other `/ns/name`."""
    base = topic.name.removesuffix("/compressed") if topic.msgtype == COMPRESSED_IMAGE else topic.name
    return base.rpartition("/")[0]


class BagSource:
    """A bag: its image topic decoded, all other messages as they were recorded."""

    def __init__(self, path: Path, reader: BagReader, image_topic: str | None) -> None:
        self.name = str(path)
        self.topics = reader.topics
        self.image_topic = _choose_topic(self.name, reader.topics, image_topic)
        self.count: int | None = reader.topics[self.image_topic].count
        self._reader = reader

    @property
    def warnings(self) -> list[str]:
        return self._reader.warnings

    def items(self, limit: int | None = None, others: Collection[str] | None = None) -> Iterator[Picture | Message]:
        wanted = None if others is None else {self.image_topic, *others}
        return _readable(self, _limited(map(self._item, self._reader.messages(wanted)), limit))

    def frames(self, limit: int | None = None) -> Iterator[Picture]:
        pictures = map(self._picture, self._reader.messages([self.image_topic]))
        return _pictures(_readable(self, _limited(pictures, limit)))

    def rate_hz(self) -> float:
        messages = itertools.islice(self._reader.messages([self.image_topic]), _RATE_FRAMES)
        return _rate_hz([_stamp_of(message) for message in messages])

    def camera(self) -> Camera:
        name = namespace_of(self.topics[self.image_topic]) + "/camera_info"
        topic = self.topics.get(name)
        if topic is None or topic.msgtype != CAMERA_INFO:
            raise InputError(f"{self.name}: use_camera_info needs a topic {name} of type {CAMERA_INFO}, there is none")
        for message in self._reader.messages([name]):
            return self._fitting(name, message)
        raise InputError(f"{self.name}: use_camera_info needs a message on {name}, there is none")

    def _fitting(self, name: str, message: Message) -> Camera:
        """The camera in a message of topic `name`, which must have the size of the first readable picture."""
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

    def _item(self, message: Message) -> Picture | Message:
        return self._picture(message) if message.topic == self.image_topic else message

    def _picture(self, message: Message) -> Picture:
        decoded: Decoded
        try:
            decoded = read_image(message.data, self.topics[self.image_topic].msgtype)
            stamp_ns = decoded.stamp_ns
        except MessageError as error:
            decoded, stamp_ns = error, _stamp_of(message)
        return Picture(message.log_time_ns, message.publish_time_ns, stamp_ns, decoded, message.data)


class PictureSource:
    """A video or a folder of images, as if the pictures had been recorded on `/camera/image_raw`."""

    def __init__(self, path: Path, pictures: Pictures) -> None:
        self.name = str(path)
        self.image_topic = PICTURE_TOPIC
        self.count = pictures.count
        self.topics = {PICTURE_TOPIC: topic_of(PICTURE_TOPIC, IMAGE)}
        self._pictures = pictures

    @property
    def warnings(self) -> list[str]:
        return self._pictures.warnings

    def items(self, limit: int | None = None, others: Collection[str] | None = None) -> Iterator[Picture | Message]:
        del others  # there are none
        pictures = (Picture(stamp, stamp, stamp, decoded) for stamp, decoded in self._pictures.frames())
        return _readable(self, _limited(pictures, limit))

    def frames(self, limit: int | None = None) -> Iterator[Picture]:
        return _pictures(self.items(limit))

    def rate_hz(self) -> float:
        return self._pictures.fps

    def camera(self) -> Camera:
        raise InputError(f"{self.name}: use_camera_info needs a bag with camera_info, this is none")


def _choose_topic(name: str, topics: Mapping[str, Topic], wanted: str | None) -> str:
    images = sorted(topic.name for topic in topics.values() if topic.msgtype in IMAGE_TYPES)
    if not images:
        raise InputError(f"{name}: holds no images; it must have a topic of type {' or '.join(IMAGE_TYPES)}")
    if wanted is not None and wanted not in images:
        raise InputError(f"{name}: has no image topic {wanted}; its image topics are {', '.join(images)}")
    filled = [topic for topic in images if topics[topic].count > 0 and not topic.endswith(SINGLE_IMAGES)]
    if wanted is None and len(filled) > 1:
        raise InputError(f"{name}: has several image topics, name one with --image-topic: {', '.join(filled)}")
    return wanted or (filled or images)[0]


def _limited(items: Iterable[Picture | Message], limit: int | None) -> Iterator[Picture | Message]:
    pictures = 0
    for item in items:
        if isinstance(item, Picture):
            if pictures == limit:
                return
            pictures += 1
        yield item


def _readable(source: Source, items: Iterable[Picture | Message]) -> Iterator[Picture | Message]:
    problem, readable = "it is empty", False
    for item in items:
        if isinstance(item, Picture):
            readable = readable or isinstance(item.decoded, Frame)
            problem = problem if isinstance(item.decoded, Frame) else str(item.decoded)
        yield item
    if not readable:
        raise InputError(f"{source.name}: not one image of {source.image_topic} can be decoded ({problem}); "
                         "it must hold at least one")


def _pictures(items: Iterable[Picture | Message]) -> Iterator[Picture]:
    return (item for item in items if isinstance(item, Picture))


def _stamp_of(message: Message) -> int:
    try:
        return read_stamp(message.data)
    except MessageError:
        return message.log_time_ns


def _rate_hz(stamps_ns: list[int]) -> float:
    steps = [after - before for before, after in itertools.pairwise(stamps_ns) if after > before]
    rate = 1e9 / statistics.median(steps) if steps else DEFAULT_FPS
    return rate if 0 < rate <= MAX_FPS else DEFAULT_FPS
