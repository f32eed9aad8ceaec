"""One way to read every input: a bag, a video file or a folder of images is a stream of images and other messages."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Protocol

from stab_ros.core.errors import InputError
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import Extra, Message, Topic, open_bag
from stab_ros.io.bag_source import REFERENCE_IMAGE, SINGLE_IMAGES, STATIC_MAP, BagSource
from stab_ros.io.image_folder import ImageFolder
from stab_ros.io.image_topic import holds_images, is_stabilized, namespace_of, no_images
from stab_ros.io.input_kind import Kind, kind_of
from stab_ros.io.picture import Clock, Picture
from stab_ros.io.video import VideoFile
from stab_ros.io.video_source import PICTURE_TOPIC, VideoSource

__all__ = [
    "PICTURE_TOPIC", "REFERENCE_IMAGE", "SINGLE_IMAGES", "STATIC_MAP", "BagSource", "Clock", "Kind", "Picture",
    "Source", "VideoSource", "holds_images", "is_stabilized", "kind_of", "namespace_of", "no_images", "open_source",
    "read_again",
]


class Source(Protocol):
    """A recording: the images of one topic among all other messages, in the order in which they were logged.

    Attributes:
        name: the path, for messages.
        image_topic: the topic of the images.
        count: number of images; None where the input does not say.
    """

    name: str
    image_topic: str
    count: int | None

    @property
    def topics(self) -> Mapping[str, Topic]:
        """All topics by name, `image_topic` among them."""

    @property
    def warnings(self) -> list[str]:
        """What could not be read, one line each; complete once `items` is exhausted."""

    def items(self, limit: int | None = None, others: Collection[str] | None = None) -> Iterator[Picture | Message]:
        """Reads images and other messages.

        Args:
            limit: stop after so many images; None: read all.
            others: the other topics to read; None: all of them.

        Returns:
            An iterator over images and messages in the order in which they were logged; the images of a coded video in
            the order in which they are shown, which may be another one.

        Raises:
            InputError: at the end, if not one image could be decoded.
        """

    def frames(self, limit: int | None = None) -> Iterator[Picture]:
        """Reads the images alone.

        Args:
            limit: stop after so many images; None: read all.

        Returns:
            An iterator over the images.

        Raises:
            InputError: as `items`.
        """

    def extras(self) -> Iterator[Extra]:
        """Reads the attachments and metadata of an MCAP recording.

        Returns:
            An iterator over them; other recordings have none.
        """

    def rate_hz(self) -> float:
        """Estimates the frame rate.

        Returns:
            Frames per second, from the stamps.
        """

    def camera(self) -> Camera:
        """Reads the calibration of the camera.

        Returns:
            The camera that took the images.

        Raises:
            InputError: the recording holds no camera_info, or one for another image size.
        """


@contextmanager
def open_source(path: Path, image_topic: str | None = None, fps: float | None = None,
                clock: Clock = Clock.HEADER) -> Iterator[Source]:
    """Opens a recording: a context manager.

    Args:
        path: an MCAP file, a rosbag2 folder, a ROS 1 bag, a video file or a folder of images, in the
            order of the numbers in their names.
        image_topic: which topic to read; may be left out where there is only one image topic.
        fps: frames per second of a video or a folder; None: as the file says, else 25.
        clock: what images of a bag are stamped with; a video or a folder has one clock only.

    Yields:
        The recording.

    Raises:
        InputError: the input is missing, is of no known kind, or has no such image topic.
    """
    kind = kind_of(path)
    if kind is Kind.BAG:
        with open_bag(path) as reader:
            yield BagSource(path, reader, image_topic, clock)
    else:
        if image_topic not in (None, PICTURE_TOPIC):
            raise InputError(f"{path}: a {kind.value} has no topic {image_topic}, its one topic is {PICTURE_TOPIC}")
        check_clock(path, kind, clock)
        with closing(VideoFile(path, fps) if kind is Kind.VIDEO else ImageFolder(path, fps)) as reader:
            yield VideoSource(path, reader)


def check_clock(path: Path, kind: Kind, clock: Clock) -> None:
    """Raises InputError for log times of a video or a folder."""
    if clock is Clock.LOG and kind is not Kind.BAG:
        raise InputError(f"{path}: is a {kind.value} and has no log times, --time log is for bags; leave it out")


def read_again(path: Path, image_topic: str | None, fps: float | None, clock: Clock, limit: int | None,
               number: int) -> Generator[Picture, None, None]:
    """Opens an input a second time; yields those of its first `limit` images that come from `number` on."""
    with open_source(path, image_topic, fps, clock) as source:
        yield from itertools.islice(source.frames(limit), number, None)
