"""Everything that the tracker publishes but its diagnostics."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.memory import give_back_memory
from stab_ros.core.types import Frame, State, Track
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import Header, header_of
from stab_ros.io.homography_message import homography_cdr
from stab_ros.io.image_message import image_cdr, static_map_cdr
from stab_ros.io.topics import (
    DEBUG_IMAGE_TOPIC,
    HOMOGRAPHY_TOPIC,
    REFERENCE_IMAGE_TOPIC,
    STATIC_MAP_TOPIC,
    TRACK_TOPIC,
    private,
)
from stab_ros.io.track_message import track_cdr
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import LATCHED
from stab_ros.nodes.stabilized_pictures import StabilizedPictures
from stab_ros.tracking.debug_image import draw_debug
from stab_ros.tracking.stabilizer import Stabilizer
from stab_ros.tracking.static_map import StaticMap


class TrackerPublishers:
    """lossless: homography, track and image_stabilized wait for slow RELIABLE subscribers.

    pictures: of the stabilised frames.
    """

    def __init__(self, node: StabNode, lossless: bool, pictures: StabilizedPictures) -> None:
        self.pictures = pictures
        self.homography = CdrPublisher(node, CameraInfo, HOMOGRAPHY_TOPIC, QoSProfile(depth=100), lossless)
        self._track = CdrPublisher(node, DiagnosticArray, private(TRACK_TOPIC), QoSProfile(depth=100), lossless)
        self._reference_image = CdrPublisher(node, Image, private(REFERENCE_IMAGE_TOPIC), LATCHED)
        self._static_map = CdrPublisher(node, Image, private(STATIC_MAP_TOPIC), LATCHED)
        self._debug_image = CdrPublisher(node, Image, private(DEBUG_IMAGE_TOPIC), QoSProfile(depth=1))

    @property
    def subscribers(self) -> int:
        """Of all topics."""
        own = (self.homography, self._track, self._reference_image, self._static_map, self._debug_image)
        return self.pictures.subscribers + sum(publisher.subscribers for publisher in own)

    def send_track(self, track: Track, header: Header, size: tuple[int, int], camera: Camera | None,
                   stabilizer: Stabilizer) -> None:
        """size: of the reference, or of the frame if it is lost without one."""
        self.homography.send(homography_cdr(track, header, size, camera))
        self._track.send(track_cdr(track, header, stabilizer.window))

    def send_images(self, frame: Frame, track: Track, stabilizer: Stabilizer) -> None:
        """The stabilised image and the debug image, each only if it has subscribers."""
        self.pictures.send(frame, track, stabilizer)
        if self._debug_image.subscribers:
            self._debug_image.send(image_cdr(draw_debug(frame, stabilizer), "bgr8", header_of(frame)))

    def send_reference(self, reference: Frame, stabilizer: Stabilizer) -> None:
        """The reference without lens distortion, as image_stabilized shows it."""
        identity = Track(State.TRACKED, 0, reference.stamp_ns, reference.stamp_ns, 0, ref_H_cur=np.eye(3))
        image = stabilizer.warp(reference, identity)
        if image is not None:
            self._reference_image.send(image_cdr(image, reference.warped_encoding, header_of(reference)))

    def send_static_map(self, static_map: StaticMap, reference: Frame) -> None:
        give_back_memory()
        self._static_map.send(static_map_cdr(static_map, header_of(reference)))

    def flush(self) -> None:
        """Waits for the acknowledgements of the last results."""
        for publisher in (self.homography, self._track, self.pictures):
            publisher.flush()
