"""The topics that the evaluator subscribes to, decoded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.errors import MessageError
from stab_ros.core.gray import without_colour
from stab_ros.core.types import Frame, Homography
from stab_ros.io.camera_message import read_size
from stab_ros.io.cdr import IMAGE
from stab_ros.io.homography_message import read_homography
from stab_ros.io.image_message import read_image
from stab_ros.io.topics import HOMOGRAPHY_TOPIC, REFERENCE_IMAGE_TOPIC, STABILIZED_TOPIC
from stab_ros.nodes.qos import AdaptiveSubscription, RawCallback, keep_all_offered, latest_latched
from stab_ros.nodes.tracker_subscription import TrackerSubscription

_FIX = "let it offer RELIABLE or BEST_EFFORT, VOLATILE or TRANSIENT_LOCAL"


class EvaluatorCallbacks(Protocol):
    """Who takes the decoded messages."""

    def on_image(self, frame: Frame) -> None:
        """A stabilised image, without colour."""

    def on_homography(self, stamp_ns: int, ref_H_cur: Homography | None, size: tuple[int, int] | None) -> None:
        """ref_H_cur: None if the frame is lost. size: of the reference (width, height), if known."""

    def on_reference(self, frame: Frame) -> None:
        """The tracker's reference, without colour."""

    def on_refused(self, text: str) -> None:
        """A message that cannot be decoded."""


class EvaluatorInputs:
    """received: number of messages so far."""

    def __init__(self, node: Node, callbacks: EvaluatorCallbacks) -> None:
        self.received = 0
        self._node, self._callbacks = node, callbacks
        self.image = self._subscribe(STABILIZED_TOPIC, Image, self._on_image)
        self.reference = TrackerSubscription(
            node, Image, REFERENCE_IMAGE_TOPIC, self._taking(lambda: self.reference.topic, self._on_reference),
            latest_latched, "the first image is the reference")
        # the last one: a tracker that waits for subscribers of `homography` starts now
        self.homography = self._subscribe(HOMOGRAPHY_TOPIC, CameraInfo, self._on_homography)

    def refresh(self) -> None:
        """Follows the publishers; a reference is missed where images are published."""
        self.image.refresh()
        self.reference.refresh(needed=self.image.publishers > 0)
        self.homography.refresh()

    def close(self) -> None:
        """Ends the subscriptions."""
        for subscription in (self.image, self.reference, self.homography):
            subscription.close()

    def _subscribe(self, name: str, msg_class: Any, take: Callable[[bytes], None]) -> AdaptiveSubscription:
        topic = self._node.resolve_topic_name(name)
        return AdaptiveSubscription(self._node, msg_class, name, self._taking(lambda: topic, take), keep_all_offered,
                                    _FIX)

    def _taking(self, topic: Callable[[], str], take: Callable[[bytes], None]) -> RawCallback:
        def on_message(cdr: bytes, _info: Mapping[str, int]) -> None:
            self.received += 1
            try:
                take(cdr)
            except MessageError as error:
                self._callbacks.on_refused(f"{topic()}: {error}")

        return on_message

    def _on_image(self, cdr: bytes) -> None:
        self._callbacks.on_image(without_colour(read_image(cdr, IMAGE)))

    def _on_reference(self, cdr: bytes) -> None:
        self._callbacks.on_reference(without_colour(read_image(cdr, IMAGE)))

    def _on_homography(self, cdr: bytes) -> None:
        self._callbacks.on_homography(*read_homography(cdr), read_size(cdr))
