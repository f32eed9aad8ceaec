"""A video file or a folder of images as a source: one image topic, no other messages."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import Extra, Message, topic_of
from stab_ros.io.cdr import IMAGE
from stab_ros.io.frame_reader import FrameReader
from stab_ros.io.picture import Picture, limited, only_pictures, readable
from stab_ros.io.repeated_pictures import RepeatedPictures
from stab_ros.io.topics import DEFAULT_NAMESPACE, RAW_TOPIC, topic_in

PICTURE_TOPIC = topic_in(DEFAULT_NAMESPACE, RAW_TOPIC)


class VideoSource:
    """A video or a folder of images, as if its images had been recorded on `/camera/image_raw`."""

    def __init__(self, path: Path, reader: FrameReader) -> None:
        self.name = str(path)
        self.image_topic = PICTURE_TOPIC
        self.count = reader.count
        self.topics = {PICTURE_TOPIC: topic_of(PICTURE_TOPIC, IMAGE)}
        self._reader = reader
        self._repeated = RepeatedPictures()

    @property
    def warnings(self) -> list[str]:
        copies = self._repeated.remark()
        return [*self._reader.warnings, *([f"{self.name}: {copies}"] if copies else [])]

    def items(self, limit: int | None = None, others: Collection[str] | None = None) -> Iterator[Picture | Message]:
        del others  # there are none
        pictures = (Picture(stamp, stamp, stamp, decoded) for stamp, decoded in self._reader.frames())
        self._repeated = RepeatedPictures()
        return readable(self.name, self.image_topic, self._repeated.watched(limited(pictures, limit)))

    def frames(self, limit: int | None = None) -> Iterator[Picture]:
        return only_pictures(self.items(limit))

    def extras(self) -> Iterator[Extra]:
        return iter(())

    def rate_hz(self) -> float:
        return self._reader.fps

    def camera(self) -> Camera:
        raise InputError(f"{self.name}: use_camera_info needs a bag with camera_info, this is none")
