"""A minimal velocimeter: the surface velocity of the water in one window of the reference, in m/s.

    python velocimetry_node.py --ros-args -r __ns:=/camera -p gsd_m:=0.01 -p window:=[200,100,96,64]

It subscribes to `image_raw` (mono8) and to the tracker's `homography`, and pairs them by stamp. The window is cut out
of each image in the place of the reference, so that the motion of the drone is gone. Corners are then followed from one
window to the next (Lucas-Kanade, with image pyramids), and the median of their displacements is published on
`~/velocity`: x to the right, y downwards.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import rclpy
from geometry_msgs.msg import Vector3Stamped
from numpy.typing import NDArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

Gray = NDArray[np.uint8]
_KEPT = 200  # messages without a partner: the tracker answers the frames of its first second late
_CORNERS, _QUALITY, _DISTANCE_PX = 200, 0.01, 5
_FEWEST = 10  # corners of which a median is taken


@dataclass(frozen=True)
class Measured:
    """The window of one frame. stamp_ns: its header stamp."""

    stamp_ns: int
    window: Gray


class VelocimetryNode(Node):
    """Pairs images and homographies by stamp, and measures from each pair to the next."""

    def __init__(self) -> None:
        super().__init__("velocimetry_node")
        self._gsd_m = float(self.declare_parameter("gsd_m", 0.01).value)
        self._window = [int(value) for value in self.declare_parameter("window", [0, 0, 64, 64]).value]
        self._images: dict[int, Image] = {}
        self._homographies: dict[int, CameraInfo] = {}
        self._before: Measured | None = None
        self._velocity = self.create_publisher(Vector3Stamped, "~/velocity", 100)
        self.create_subscription(Image, "image_raw", lambda message: self._take(message, self._images), 100)
        self.create_subscription(CameraInfo, "homography", lambda message: self._take(message, self._homographies), 100)

    def _take(self, message: Any, kept: dict[int, Any]) -> None:
        """Keeps the message, and measures if its partner is there."""
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        kept[stamp_ns] = message
        if stamp_ns in self._images and stamp_ns in self._homographies:
            self._measure(stamp_ns, self._images.pop(stamp_ns), self._homographies.pop(stamp_ns))
        while len(kept) > _KEPT:
            kept.pop(next(iter(kept)))  # the oldest

    def _measure(self, stamp_ns: int, image: Image, answer: CameraInfo) -> None:
        ref_H_cur = homography(answer)
        if ref_H_cur is None:  # the frame is lost
            return
        before, self._before = self._before, Measured(stamp_ns, cut(gray(image), ref_H_cur, self._window))
        shift_px = displacement_px(before.window, self._before.window) if before is not None else None
        if before is None or shift_px is None or stamp_ns <= before.stamp_ns:
            return
        message = Vector3Stamped(header=image.header)
        message.vector.x, message.vector.y = (shift_px * self._gsd_m * 1e9 / (stamp_ns - before.stamp_ns)).tolist()
        self._velocity.publish(message)


def homography(message: CameraInfo) -> NDArray[np.float64] | None:
    """`ref_H_cur` (3, 3), which maps pixels of the frame to pixels of the reference; None while the frame is lost."""
    K, R, P = np.reshape(message.k, (3, 3)), np.reshape(message.r, (3, 3)), np.reshape(message.p, (3, 4))
    return P[:, :3] @ R @ np.linalg.inv(K) if K.any() else None


def gray(message: Image) -> Gray:
    """The image of a mono8 message, (h, w) uint8."""
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)[:, : message.width]


def cut(image: Gray, ref_H_cur: NDArray[np.float64], window: list[int]) -> Gray:
    """The window x, y, width, height (px of the reference) of an image."""
    x, y, width, height = window
    window_H_ref = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
    return np.asarray(cv2.warpPerspective(image, window_H_ref @ ref_H_cur, (width, height)), np.uint8)


def displacement_px(before: Gray, after: Gray) -> NDArray[np.float64] | None:
    """Median displacement (2,) of the corners of one window in the next; None with too few of them."""
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, _QUALITY, _DISTANCE_PX)
    if corners is None:
        return None
    moved, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None)
    shifts_px = (moved - corners).reshape(-1, 2)[found.ravel() == 1]
    return np.median(shifts_px, axis=0).astype(np.float64) if len(shifts_px) >= _FEWEST else None


def main() -> None:
    """Runs until it is interrupted."""
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(VelocimetryNode())


if __name__ == "__main__":
    main()
