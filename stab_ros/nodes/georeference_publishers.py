"""Everything that the georeference node publishes but its diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image, NavSatFix
from visualization_msgs.msg import MarkerArray

from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import header_of
from stab_ros.io.georeference_messages import georeference_status_cdr, map_header, ortho_info_cdr
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.io.pose_message import pose_cdr
from stab_ros.io.topics import (
    GCPS_TOPIC,
    ORIGIN_TOPIC,
    ORTHO_INFO_TOPIC,
    ORTHO_TOPIC,
    POSE_TOPIC,
    STATUS_TOPIC,
    private,
)
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import LATCHED


class GeoreferencePublishers:
    """lossless: all but the latched topics wait for slow RELIABLE subscribers."""

    def __init__(self, node: StabNode, lossless: bool) -> None:
        self.info = CdrPublisher(node, CameraInfo, ORTHO_INFO_TOPIC, QoSProfile(depth=100), lossless)
        self._image = CdrPublisher(node, Image, ORTHO_TOPIC, QoSProfile(depth=1), lossless)
        self._status = CdrPublisher(node, DiagnosticArray, private(STATUS_TOPIC), QoSProfile(depth=100), lossless)
        self._pose = CdrPublisher(node, PoseWithCovarianceStamped, private(POSE_TOPIC), QoSProfile(depth=100), lossless)
        self._origin = CdrPublisher(node, NavSatFix, private(ORIGIN_TOPIC), LATCHED)
        self._gcps = CdrPublisher(node, MarkerArray, private(GCPS_TOPIC), LATCHED)

    def send(self, one: Georeferenced, camera: Camera | None, orientation: str) -> None:
        """What is told of every frame. camera: that took it; None: its lens distortion is not known, or removed."""
        self.info.send(ortho_info_cdr(one, camera))
        self._status.send(georeference_status_cdr(one, orientation))
        if one.placement is not None and one.placement.pose is not None:
            self._pose.send(pose_cdr(one.placement.pose, one.placement.pose_covariance, map_header(one)))

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
        for publisher in (self.info, self._status, self._pose, self._image):
            publisher.flush()
