"""One way to read every input: a bag, a video file or a folder of images is a stream of images and other messages."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Protocol

from stab_ros.core.errors import InputError
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import Message, Topic, open_bag
from stab_ros.io.bag_source import REFERENCE_IMAGE, SINGLE_IMAGES, STATIC_MAP, BagSource, namespace_of
from stab_ros.io.image_folder import ImageFolder
from stab_ros.io.image_message import IMAGE_TYPES
from stab_ros.io.input_kind import Kind, kind_of
from stab_ros.io.picture import Picture
from stab_ros.io.video import VideoFile
from stab_ros.io.video_source import PICTURE_TOPIC, VideoSource

__all__ = [
    "IMAGE_TYPES", "PICTURE_TOPIC", "REFERENCE_IMAGE", "SINGLE_IMAGES", "STATIC_MAP", "BagSource", "Kind", "Picture",
    "Source", "VideoSource", "kind_of", "namespace_of", "open_source", "read_again",
]


class Source(Protocol):
    """A stream to stabilise: the images of `image_topic` among all other messages, in the order they were logged.

    count: number of images, None if the input does not announce it. topics: all topics, `image_topic` among them.
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
        """Everything, up to `limit` images; of the other topics only `others`, if given.

        Raises:
            InputError: at the end, if not one image could be decoded.
        """

    def frames(self, limit: int | None = None) -> Iterator[Picture]:
        """The images alone, as `items`."""

    def rate_hz(self) -> float:
        """Frames per second, from the stamps."""

    def camera(self) -> Camera:
        """The camera that took the images.

        Raises:
            InputError: the input holds no camera_info, or one of another image size.
        """


@contextmanager
def open_source(path: Path, image_topic: str | None = None, fps: float | None = None) -> Iterator[Source]:
    """Opens any input. `fps` applies to videos and folders; `image_topic` may be omitted if there is only one.

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
        with closing(VideoFile(path, fps) if kind is Kind.VIDEO else ImageFolder(path, fps)) as reader:
            yield VideoSource(path, reader)


def read_again(path: Path, image_topic: str | None, fps: float | None, limit: int | None,
               number: int) -> Generator[Picture, None, None]:
    """Opens an input a second time; yields those of its first `limit` images that come from `number` on."""
    with open_source(path, image_topic, fps) as source:
        yield from itertools.islice(source.frames(limit), number, None)
