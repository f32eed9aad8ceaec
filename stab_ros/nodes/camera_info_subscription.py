"""camera_info for the tracker: the camera that took the images, once a usable message has arrived."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from stab_ros.core.errors import InputError
from stab_ros.imaging.camera import Camera
from stab_ros.io.camera_message import read_camera
from stab_ros.io.topics import CAMERA_INFO_TOPIC
from stab_ros.nodes.missing_publisher import MissingPublisher
from stab_ros.nodes.qos import AdaptiveSubscription, keep_all_offered

_WARN_EVERY_S = 5.0


class CameraInfoSubscription:
    """camera: whose lens distortion is removed from the images; None until one is known.

    A later message may correct it until `locked`: the camera that the reference was taken with is kept to the end.
    message: its CameraInfo as CDR. given_up: images go without, as nobody publishes it and they can.
    """

    def __init__(self, node: Node, changed: Callable[[], None], needed: Callable[[], bool] = lambda: True) -> None:
        """needed: whether images cannot do without, as it is set; else they wait while somebody may publish it."""
        self._needed, self.given_up = needed, False
        self.camera: Camera | None = None
        self.message: bytes | None = None
        self.locked = False
        self._logger = node.get_logger()
        self._changed = changed
        self._refusal = ""  # of the last message, as long as no camera is known
        self._missing = MissingPublisher(self._logger)
        self._input = AdaptiveSubscription(node, CameraInfo, CAMERA_INFO_TOPIC, self._on_camera, keep_all_offered,
                                           "let it publish VOLATILE or TRANSIENT_LOCAL, RELIABLE or BEST_EFFORT")
        self.topic = self._input.topic

    def restore(self, message: bytes) -> None:
        """The camera of a reference that an earlier run saved; it stays, whatever has been told before.

        Raises MessageError for a damaged message.
        """
        told, self.camera = self.camera, read_camera(message)
        self.message, self.locked = message, True
        if told is not None and not _equal(told, self.camera):
            self._warn_of_change()

    def refresh(self, images_wait: bool = False) -> None:
        """Follows the publishers' QoS. images_wait: whether they do for the camera."""
        self._input.refresh()
        missing = self._missing.look(images_wait, self._input.publishers, self._without)
        if self.locked:
            return  # it would come too late
        before, self.given_up = self.given_up, missing and not self._needed()
        if self.given_up and not before:
            self._changed()

    @property
    def _without(self) -> str:
        """What becomes of images where nobody publishes it, for people."""
        if self._needed():
            return (f"nobody publishes {self.topic}, no image is used before it comes; publish it, or set "
                    "use_camera_info:=false to do without calibration")
        return (f"nobody publishes {self.topic}, images are used without calibration, by the scale that is given; "
                "publish it, or set use_camera_info:=false not to wait for it")

    @property
    def awaited(self) -> str:
        """What is needed for the camera to be known, for people; "" where it is."""
        if self.camera is not None or self.given_up:
            return ""
        if self._refusal:
            return f"a usable message on {self.topic}, the last one is refused: {self._refusal}"
        return f"messages on {self.topic}" + ("" if self._input.publishers else ", nobody publishes it")

    def _on_camera(self, cdr: bytes, _info: Mapping[str, int]) -> None:
        try:
            camera = read_camera(cdr)
        except InputError as error:
            self._refusal = str(error)
            self._logger.warning(f"{self.topic} is refused: {error}", throttle_duration_sec=_WARN_EVERY_S)
            return
        if self.camera is not None and _equal(camera, self.camera):
            return
        if self.locked:
            self._warn_of_change()
            return
        self.camera, self.message = camera, cdr
        self._changed()

    def _warn_of_change(self) -> None:
        told = ("has changed, the camera that took the reference is kept" if self.camera is not None else
                "comes too late, images are used without calibration; let it be published before them")
        self._logger.warning(f"{self.topic} {told}", throttle_duration_sec=_WARN_EVERY_S)


def _equal(a: Camera, b: Camera) -> bool:
    return (a.size, a.model) == (b.size, b.model) and np.array_equal(a.K, b.K) and np.array_equal(a.D, b.D)
