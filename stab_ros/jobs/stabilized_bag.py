"""The output bag of a stabilisation: the new messages of every frame, and the copied messages of the input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stab_ros.core.types import Frame, Track
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.window import Window
from stab_ros.io.bag import BagWriter, Message, Topic
from stab_ros.io.camera_message import is_of
from stab_ros.io.cdr import CAMERA_INFO, DIAGNOSTIC_ARRAY, IMAGE, header_of
from stab_ros.io.homography_message import homography_cdr
from stab_ros.io.image_message import image_cdr, static_map_cdr
from stab_ros.io.source import STATIC_MAP, Picture, Source, namespace_of
from stab_ros.io.topics import CAMERA_INFO_TOPIC, topic_in
from stab_ros.io.track_message import track_cdr
from stab_ros.jobs.output_bag import OutputBag
from stab_ros.tracking.static_map import StaticMap


@dataclass(frozen=True)
class Names:
    """The output topics of one image topic; `image` is None with --no-image."""

    homography: str
    track: str
    static_map: str
    image: str | None

    @property
    def types(self) -> Mapping[str, str]:
        made = {self.homography: CAMERA_INFO, self.track: DIAGNOSTIC_ARRAY, self.static_map: IMAGE}
        return made if self.image is None else {**made, self.image: IMAGE}


def names_for(image_topic: Topic, with_image: bool) -> Names:
    """The output topics of `image_topic`."""
    namespace = namespace_of(image_topic)
    image = f"{namespace}/image_stabilized" if with_image else None
    return Names(f"{namespace}/homography", f"{namespace}/track", f"{namespace}{STATIC_MAP}", image)


class StabilizedBag:
    """Writes homography, track and stabilised image of every frame, and copies all else of the input byte for byte.

    It writes the static map whenever it changes. An input topic with the name of an output topic is left out
    (`replaced`). camera_change_ns: log time of the first camera_info of another camera than the one in use.

    Raises:
        WorkError: the bag cannot be written (any method).
    """

    def __init__(self, writer: BagWriter, source: Source, camera: Camera | None, with_image: bool, keep_raw: bool,
                 window: Window) -> None:
        """window: the part of the reference that the stabilised images show."""
        self.with_image = with_image
        self._camera = camera
        self.camera_change_ns: int | None = None
        self._window = window
        self._raw_topic = source.topics[source.image_topic]
        self._names = names_for(self._raw_topic, with_image)
        self.camera_topic = topic_in(namespace_of(self._raw_topic), CAMERA_INFO_TOPIC)
        self._bag = OutputBag(writer, source, self._names.types, keep_raw)

    @property
    def replaced(self) -> list[str]:
        return self._bag.replaced

    def take_over(self, message: Message) -> None:
        self._bag.take_over(message)
        if self._camera is not None and message.topic == self.camera_topic and self.camera_change_ns is None:
            self.camera_change_ns = None if is_of(self._camera, message.data) else message.log_time_ns

    def write(self, picture: Picture, track: Track, image: bytes | None, reference_size: tuple[int, int] | None,
              static_map: StaticMap | None) -> None:
        """Writes all messages of one frame, with its log time. image: its message. static_map: None if unchanged."""
        if self._raw_topic.name in self._bag.taken_over:
            self._write_raw(picture)
        frame = picture.decoded
        if not isinstance(frame, Frame):
            return
        header = header_of(frame)
        size = reference_size or frame.size
        self._bag.write(picture, self._names.homography, homography_cdr(track, header, size, self._camera))
        self._bag.write(picture, self._names.track, track_cdr(track, header, self._window))
        if static_map is not None:
            self._bag.write(picture, self._names.static_map, static_map_cdr(static_map, header))
        if self._names.image is not None and image is not None:
            self._bag.write(picture, self._names.image, image)

    def _write_raw(self, picture: Picture) -> None:
        frame = picture.decoded
        if picture.data is not None:
            self._bag.write(picture, self._raw_topic.name, picture.data)
        elif isinstance(frame, Frame):
            self._bag.write(picture, self._raw_topic.name, image_cdr(frame.image, frame.encoding, header_of(frame)))
