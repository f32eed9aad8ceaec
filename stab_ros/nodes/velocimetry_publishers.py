"""Everything that the velocimetry node publishes but its diagnostics."""

from __future__ import annotations

from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, NavSatFix, PointCloud2
from visualization_msgs.msg import MarkerArray

from stab_ros.io.topics import (
    IMAGE_VELOCITY_TOPIC,
    MARKERS_TOPIC,
    ORIGIN_TOPIC,
    VELOCITY_GRID_TOPIC,
    VELOCITY_TOPIC,
    private,
)
from stab_ros.jobs.velocity_messages import VelocityMessages, image_velocity_cdr
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import LATCHED
from stab_ros.velocimetry.velocimeter import Measured


class VelocimetryPublishers:
    """lossless: topics wait for slow RELIABLE subscribers. grid_m: side of the cells; 0: what suits."""

    def __init__(self, node: StabNode, grid_m: float, lossless: bool) -> None:
        self.velocity = CdrPublisher(node, PointCloud2, VELOCITY_TOPIC, QoSProfile(depth=100), lossless)
        self._grid = CdrPublisher(node, PointCloud2, VELOCITY_GRID_TOPIC, QoSProfile(depth=100), lossless)
        self._markers = CdrPublisher(node, MarkerArray, private(MARKERS_TOPIC), QoSProfile(depth=10), lossless)
        self._image = CdrPublisher(node, Image, private(IMAGE_VELOCITY_TOPIC), QoSProfile(depth=1), lossless)
        self._origin = CdrPublisher(node, NavSatFix, private(ORIGIN_TOPIC), LATCHED)
        self._messages = VelocityMessages(grid_m)

    def send(self, measured: Measured) -> None:
        """What is told of an interval; the picture only if somebody subscribes."""
        messages = self._messages.of(measured)
        self.velocity.send(messages.velocity)
        self._grid.send(messages.grid)
        self._markers.send(messages.markers)
        if self._image.subscribers:
            self._image.send(image_velocity_cdr(measured))

    def send_origin(self, cdr: bytes) -> None:
        """The origin of the map, latched."""
        self._origin.send(cdr)

    def flush(self) -> None:
        """Waits for the acknowledgements of the last results."""
        for publisher in (self.velocity, self._grid, self._markers, self._image):
            publisher.flush()
