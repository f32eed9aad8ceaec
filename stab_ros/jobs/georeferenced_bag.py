"""The output bag of georeferencing: the new messages of every frame, and the copied messages of the input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import BagWriter, Message
from stab_ros.io.cdr import (
    CAMERA_INFO,
    DIAGNOSTIC_ARRAY,
    IMAGE,
    MARKER_ARRAY,
    NAV_SAT_FIX,
    POSE_WITH_COVARIANCE_STAMPED,
    TWIST_WITH_COVARIANCE_STAMPED,
)
from stab_ros.io.georeference_messages import (
    gcps_of_cdr,
    georeference_status_cdr,
    motion_cdr,
    origin_cdr,
    ortho_info_cdr,
    pose_of_cdr,
)
from stab_ros.io.source import Picture, Source, namespace_of
from stab_ros.io.topics import (
    GCPS_TOPIC,
    GEOREFERENCE_NAME,
    MOTION_TOPIC,
    ORIGIN_TOPIC,
    ORTHO_INFO_TOPIC,
    ORTHO_TOPIC,
    POSE_TOPIC,
    STATUS_TOPIC,
    topic_in,
)
from stab_ros.jobs.camera_transforms import CameraTransforms
from stab_ros.jobs.output_bag import OutputBag


@dataclass(frozen=True)
class GeoreferenceTopics:
    """The output topics of one camera."""

    image: str
    info: str
    pose: str
    motion: str
    origin: str
    gcps: str
    status: str

    @staticmethod
    def of(namespace: str) -> GeoreferenceTopics:
        """The topics that a georeference_node in this namespace publishes."""
        node = topic_in(namespace, GEOREFERENCE_NAME)
        return GeoreferenceTopics(
            topic_in(namespace, ORTHO_TOPIC), topic_in(namespace, ORTHO_INFO_TOPIC),
            *(topic_in(node, name) for name in (POSE_TOPIC, MOTION_TOPIC, ORIGIN_TOPIC, GCPS_TOPIC, STATUS_TOPIC)))

    @property
    def types(self) -> Mapping[str, str]:
        return {self.image: IMAGE, self.info: CAMERA_INFO, self.pose: POSE_WITH_COVARIANCE_STAMPED,
                self.motion: TWIST_WITH_COVARIANCE_STAMPED, self.origin: NAV_SAT_FIX, self.gcps: MARKER_ARRAY,
                self.status: DIAGNOSTIC_ARRAY}


class GeoreferencedBag:
    """Writes what is told of every frame, and copies all else of the input byte for byte, but for its images.

    An input topic with the name of an output topic is left out (`replaced`).

    Raises:
        WorkError: the bag cannot be written (any method).
    """

    def __init__(self, writer: BagWriter, source: Source, orientation: str, with_image: bool) -> None:
        self._orientation, self.with_image = orientation, with_image
        self._origin_written = False
        self._rejected: tuple[str, ...] | None = None  # as the last message of control points showed it
        self._names = GeoreferenceTopics.of(namespace_of(source.topics[source.image_topic]))
        self._transforms = CameraTransforms(source)
        types = {**self._names.types, **self._transforms.types}
        if not with_image:
            del types[self._names.image]
        self._bag = OutputBag(writer, source, types, keep_images=False)

    @property
    def replaced(self) -> list[str]:
        return self._bag.replaced

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was left out, one line each."""
        return self._transforms.warnings

    def take_over(self, message: Message) -> None:
        self._transforms.take_over(message)
        self._bag.take_over(message)

    def write_once(self, picture: Picture, answer: Georeferenced, origin: LocalFrame | None,
                   gcps: ControlPoints | None) -> None:
        """Writes origin and control points with the first frame, and the points whenever other ones are rejected."""
        if origin is not None and not self._origin_written:
            self._origin_written = True
            self._bag.write(picture, self._names.origin, origin_cdr(answer, origin))
        rejected = None if answer.placement is None else answer.placement.rejected
        if gcps is not None and rejected is not None and rejected != self._rejected:
            self._rejected = rejected
            self._bag.write(picture, self._names.gcps, gcps_of_cdr(answer, gcps))

    def write(self, picture: Picture, answer: Georeferenced, image: bytes | None, camera: Camera | None) -> None:
        """Writes all messages of one frame, with its log time.

        image: its message. camera: of the images as the homographies take them; None: of unknown K.
        """
        self._bag.write(picture, self._names.info, ortho_info_cdr(answer, camera))
        self._bag.write(picture, self._names.status, georeference_status_cdr(answer, self._orientation))
        told = {self._names.pose: pose_of_cdr(answer), self._names.motion: motion_cdr(answer),
                self._names.image: image if self.with_image else None}
        for name, data in told.items():
            if data is not None:
                self._bag.write(picture, name, data)
        self._transforms.write(answer, partial(self._bag.write, picture))
