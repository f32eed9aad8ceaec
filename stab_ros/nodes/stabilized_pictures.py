"""Publishes the stabilised picture: `image_stabilized`, `image_stabilized/compressed`, and the camera of both."""

from __future__ import annotations

from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.types import Frame, Track
from stab_ros.io.cdr import Header
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.io.topics import CAMERA_INFO_TOPIC, STABILIZED_TOPIC, compressed_topic, topic_in
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.compressed_publisher import CompressedPublisher
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.stabilized_camera import StabilizedCamera
from stab_ros.parameters.node_settings import CompressedSettings
from stab_ros.tracking.stabilizer import Showing, Stabilizer


class StabilizedPictures:
    """Each is only made while it has subscribers. frame_id: of all three; "": that of the camera's images."""

    def __init__(self, node: StabNode, camera: StabilizedCamera, compressed: CompressedSettings, frame_id: str,
                 failures: Failures, lossless: bool) -> None:
        self._camera, self._frame_id = camera, frame_id
        self._image = CdrPublisher(node, Image, STABILIZED_TOPIC, QoSProfile(depth=1), lossless)
        base = self._image.topic  # as it has been remapped
        self._info = CdrPublisher(node, CameraInfo, topic_in(base, CAMERA_INFO_TOPIC), QoSProfile(depth=10), lossless)
        self.compressed = CompressedPublisher(node, compressed_topic(base), compressed, failures, lossless)

    @property
    def subscribers(self) -> int:
        return self._image.subscribers + self._info.subscribers + self.compressed.subscribers

    def refresh(self) -> None:
        """Looks for the camera while somebody wants to know it, and at subscribers; to be called periodically."""
        self._camera.refresh(wanted=self._info.subscribers > 0)
        self.compressed.refresh()

    def send(self, frame: Frame, track: Track, stabilizer: Stabilizer) -> None:
        showing = stabilizer.showing(track)
        if showing is Showing.NOTHING:
            return
        header = Header(frame.stamp_ns, self._frame_id or frame.frame_id)
        if self._info.subscribers:
            in_place = showing is Showing.IN_PLACE
            self._info.send(self._camera.message(frame.size, stabilizer.window, in_place, header))
        raw, compressed = self._image.subscribers > 0, self.compressed.wants(frame.stamp_ns)
        if raw or compressed:
            self._send_image(frame, track, stabilizer, header, raw, compressed)

    def _send_image(self, frame: Frame, track: Track, stabilizer: Stabilizer, header: Header, raw: bool,
                    compressed: bool) -> None:
        message = OutgoingImage(frame.warped_encoding, header)
        image = stabilizer.warp(frame, track, message.allocate)
        if image is None:
            return
        if compressed:
            self.compressed.take(image, message, frame.warped_encoding, header)
        if raw:
            self._image.send(message.cdr(image))

    def flush(self) -> None:
        """Waits for the acknowledgements of the last ones."""
        for publisher in (self._image, self._info, self.compressed):
            publisher.flush()

    def close(self) -> None:
        """To be called before the node is destroyed."""
        self.compressed.close()
