"""Everything that the georeference node publishes but its diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image, NavSatFix
from visualization_msgs.msg import MarkerArray

from stab_ros.core.errors import InputError
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import TF_MESSAGE, header_of
from stab_ros.io.georeference_messages import (
    camera_transform_cdr,
    georeference_status_cdr,
    motion_cdr,
    ortho_info_cdr,
    pose_of_cdr,
)
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.io.topics import (
    GCPS_TOPIC,
    MOTION_TOPIC,
    ORIGIN_TOPIC,
    ORTHO_INFO_TOPIC,
    ORTHO_TOPIC,
    POSE_TOPIC,
    STATUS_TOPIC,
    TF_TOPIC,
    private,
)
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import LATCHED
from stab_ros.nodes.runtime import message_class


class GeoreferencePublishers:
    """lossless: all but the latched topics wait for slow RELIABLE subscribers. tf: whether /tf is one of them."""

    def __init__(self, node: StabNode, lossless: bool, tf: bool) -> None:
        self.info = CdrPublisher(node, CameraInfo, ORTHO_INFO_TOPIC, QoSProfile(depth=100), lossless)
        self._image = CdrPublisher(node, Image, ORTHO_TOPIC, QoSProfile(depth=1), lossless)
        self._status = CdrPublisher(node, DiagnosticArray, private(STATUS_TOPIC), QoSProfile(depth=100), lossless)
        self._pose = CdrPublisher(node, PoseWithCovarianceStamped, private(POSE_TOPIC), QoSProfile(depth=100), lossless)
        self._motion = CdrPublisher(node, TwistWithCovarianceStamped, private(MOTION_TOPIC), QoSProfile(depth=100),
                                    lossless)
        self._transforms = _transforms(node, lossless) if tf else None
        self._is_nameless = False  # whether that was said
        self._logger = node.get_logger()
        self._origin = CdrPublisher(node, NavSatFix, private(ORIGIN_TOPIC), LATCHED)
        self._gcps = CdrPublisher(node, MarkerArray, private(GCPS_TOPIC), LATCHED)

    def send(self, one: Georeferenced, camera: Camera | None, orientation: str) -> None:
        """What is told of every frame. camera: that took it; None: its lens distortion is not known, or removed."""
        self.info.send(ortho_info_cdr(one, camera))
        self._status.send(georeference_status_cdr(one, orientation))
        pose = pose_of_cdr(one)
        if pose is None:
            return
        self._pose.send(pose)
        motion = motion_cdr(one) if self._motion.subscribers else None
        if motion is not None:
            self._motion.send(motion)
        if self._transforms is not None:
            self._send_transform(one, self._transforms)

    def _send_transform(self, one: Georeferenced, publisher: CdrPublisher) -> None:
        data = camera_transform_cdr(one)
        if data is not None:
            publisher.send(data)
        elif not self._is_nameless:
            self._is_nameless = True
            self._logger.warning(f"the images have no frame_id, so that their camera is not on {publisher.topic}")

    def send_image(self, one: Georeferenced, engine: Georeferencer) -> None:
        """The orthophoto of a placed frame, if somebody subscribes."""
        if not self._image.subscribers or one.placement is None:
            return
        message = OutgoingImage(one.frame.warped_encoding, header_of(one.frame))
        image = engine.orthophoto(one, message.allocate)
        if image is not None:
            self._image.send(message.cdr(image))

    def send_origin(self, cdr: bytes) -> None:
        """The origin of the map, latched."""
        self._origin.send(cdr)

    def send_gcps(self, cdr: bytes) -> None:
        """The ground control points, latched."""
        self._gcps.send(cdr)

    def flush(self) -> None:
        """Waits for the acknowledgements of the last results."""
        transforms = () if self._transforms is None else (self._transforms,)
        for publisher in (self.info, self._status, self._pose, self._motion, *transforms, self._image):
            publisher.flush()


def _transforms(node: StabNode, lossless: bool) -> CdrPublisher | None:
    """The publisher of /tf, as tf2_ros' TransformBroadcaster is one; None: its messages are not installed."""
    try:
        return CdrPublisher(node, message_class(TF_MESSAGE), TF_TOPIC, QoSProfile(depth=100), lossless)
    except InputError as error:
        node.get_logger().warning(f"publish_tf has no effect: {error}")
        return None
