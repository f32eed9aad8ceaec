"""The camera of `image_stabilized`: that which took the reference, as far as it is known."""

from __future__ import annotations

from rclpy.node import Node

from stab_ros.imaging.window import Window
from stab_ros.imaging.window_camera import window_camera
from stab_ros.io.camera_message import camera_cdr
from stab_ros.io.cdr import Header
from stab_ros.nodes.camera_info_subscription import CameraInfoSubscription


class StabilizedCamera:
    """corrected: the subscription to the camera whose lens distortion is removed; None: none is removed.

    Then K and D are those of `camera_info`, which is listened to from when somebody wants to know.
    """

    def __init__(self, node: Node, corrected: CameraInfoSubscription | None) -> None:
        self._node, self._corrected, self._told = node, corrected, corrected

    def refresh(self, wanted: bool) -> None:
        """wanted: whether somebody wants to know the camera."""
        if self._corrected is None and self._told is None and wanted:
            self._told = CameraInfoSubscription(self._node, lambda: None)
        elif self._corrected is None and self._told is not None:
            self._told.refresh()

    def message(self, size: tuple[int, int], window: Window, in_place: bool, header: Header) -> bytes:
        """CameraInfo of a picture; K is zero where the camera is not known, as an uncalibrated one says it.

        size: of the frame. in_place: whether it is shown in the place of the reference, else as it was taken.
        """
        known = self._told.camera if self._told is not None else None
        camera = known if known is not None and known.size == size else None
        if not in_place:
            return camera_cdr(camera, size, header)
        shown = None if camera is None else window_camera(camera, window, self._corrected is not None)
        return camera_cdr(shown, window.size(size), header)
