"""Warps images to the reference by oneself, from `image_raw` and `homography`, which are paired by stamp.

    python warp_node.py --ros-args -r __ns:=/camera -p start_s:=1.0 -p rate_hz:=30.0

beside the tracker. Publishes `~/image_warped`, which shows what `image_stabilized` shows. Lost frames are left out.
"""

from __future__ import annotations

import contextlib
import math
from array import array
from typing import Any

import cv2
import numpy as np
import rclpy
from numpy.typing import NDArray
from pair_by_stamp import Pairing
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

_CHANNELS = {"mono8": 1, "bgr8": 3, "rgb8": 3}
_SPARE = 10  # images that come while a frame is being answered
_ZERO = 1e-200  # the tracker writes 1e-300 where there is no distortion: at 0, image_proc would pass frames through


class WarpNode(Node):
    """Publishes each tracked frame in the place of the reference."""

    def __init__(self) -> None:
        super().__init__("warp_node")
        start_s = float(self.declare_parameter("start_s", 1.0).value)
        rate_hz = float(self.declare_parameter("rate_hz", 30.0).value)
        queue = math.ceil(start_s * rate_hz) + _SPARE
        pairing = Pairing(queue, self._take)
        self._warped = self.create_publisher(Image, "~/image_warped", queue)
        self.create_subscription(Image, "image_raw", lambda message: pairing.add(0, message), queue)
        self.create_subscription(CameraInfo, "homography", lambda message: pairing.add(1, message), queue)

    def _take(self, image: Image, answer: CameraInfo) -> None:
        still = warped(pixels(image), answer)
        if still is not None:
            self._warped.publish(as_message(still, image))


def warped(image: NDArray[Any], answer: CameraInfo) -> NDArray[Any] | None:
    """The image (h, w) or (h, w, 3) in the place of the reference, black beyond its border; None while it is lost.

    H = P[:,:3] R K^-1 maps centres of pixels; that of the top left one is (0, 0), as in cv2, so nothing is to be added.
    With `use_camera_info` of the tracker, H is that of undistorted pixels, and D the distortion.
    """
    K, R, P = np.reshape(answer.k, (3, 3)), np.reshape(answer.r, (3, 3)), np.reshape(answer.p, (3, 4))[:, :3]
    D, size = np.array(answer.d), (answer.width, answer.height)
    if not K.any():
        return None
    if np.abs(D).max(initial=0.0) < _ZERO:
        return np.asarray(cv2.warpPerspective(image, P @ R @ np.linalg.inv(K), size))
    lens: Any = cv2.fisheye if answer.distortion_model == "equidistant" else cv2
    x_px, y_px = lens.initUndistortRectifyMap(K, D, R, P, size, cv2.CV_32FC1)
    return np.asarray(cv2.remap(image, x_px, y_px, cv2.INTER_LINEAR))


def pixels(message: Image) -> NDArray[np.uint8]:
    """The image of a message of 8 bit, (h, w) or (h, w, 3)."""
    width, channels = message.width, _CHANNELS[message.encoding]
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)[:, : width * channels]
    return rows if channels == 1 else rows.reshape(message.height, width, channels)


def as_message(image: NDArray[Any], source: Image) -> Image:
    """A message with the header and the encoding of the source."""
    return Image(header=source.header, height=image.shape[0], width=image.shape[1], encoding=source.encoding,
                 step=image[0].nbytes, data=array("B", image.tobytes()))


def main() -> None:
    """Runs until it is interrupted."""
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(WarpNode())


if __name__ == "__main__":
    main()
