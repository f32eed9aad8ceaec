"""What image_proc makes of the stabilised stream: rectified, resized, cut and decimated, without image_proc.

    python rectify_still.py --ros-args -r __ns:=/camera -p scale:=0.5 -p 'roi:=[30,20,200,150]' -p decimation:=2

Takes `image_stabilized` and `image_stabilized/camera_info`, and publishes `~/image_rect` and `~/camera_info`. The
formulas are those of image_proc's rectify, resize and crop_decimate, in this order; by default only
the first does anything.
"""

from __future__ import annotations

import contextlib
from copy import deepcopy
from typing import Any

import cv2
import numpy as np
import rclpy
from numpy.typing import NDArray
from pair_by_stamp import Pairing
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from warp_node import as_message, pixels

_QUEUE = 10
Picture = NDArray[Any]


class RectifyStill(Node):
    """Publishes each stabilised picture as a pinhole camera sees it, with this camera."""

    def __init__(self) -> None:
        super().__init__("rectify_still")
        self._scale = float(self.declare_parameter("scale", 1.0).value)
        self._roi = [int(value) for value in self.declare_parameter("roi", [0, 0, 0, 0]).value]
        self._decimation = int(self.declare_parameter("decimation", 1).value)
        pairing = Pairing(_QUEUE, self._take)
        self._image = self.create_publisher(Image, "~/image_rect", _QUEUE)
        self._info = self.create_publisher(CameraInfo, "~/camera_info", _QUEUE)
        self.create_subscription(Image, "image_stabilized", lambda message: pairing.add(0, message), _QUEUE)
        self.create_subscription(
            CameraInfo, "image_stabilized/camera_info", lambda message: pairing.add(1, message), _QUEUE)

    def _take(self, image: Image, info: CameraInfo) -> None:
        if not info.k[0]:  # the tracker knows no calibration
            self.get_logger().warning("K of image_stabilized/camera_info is zero: the camera is not calibrated, and "
                                      "nothing is rectified; let the tracker have its camera_info", once=True)
            return
        picture, info = resized(rectified(pixels(image), info), info, self._scale)
        picture, info = cut(picture, info, self._roi, self._decimation)
        self._image.publish(as_message(picture, image))
        self._info.publish(info)


def rectified(picture: Picture, info: CameraInfo) -> Picture:
    """image_proc's rectify: the picture without the lens, as the camera matrix P sees it."""
    if not any(info.d):
        return picture
    K, R, P = np.reshape(info.k, (3, 3)), np.reshape(info.r, (3, 3)), np.reshape(info.p, (3, 4))[:, :3]
    lens: Any = cv2.fisheye if info.distortion_model == "equidistant" else cv2
    x_px, y_px = lens.initUndistortRectifyMap(K, np.array(info.d), R, P, (info.width, info.height), cv2.CV_32FC1)
    return np.asarray(cv2.remap(picture, x_px, y_px, cv2.INTER_LINEAR))


def resized(picture: Picture, info: CameraInfo, scale: float) -> tuple[Picture, CameraInfo]:
    """image_proc's resize. It multiplies the principal point by the scale, which is (1 - scale) / 2 px too much."""
    small, row_scale = deepcopy(info), np.array([[scale], [scale], [1.0]])
    small.width, small.height = int(info.width * scale), int(info.height * scale)
    small.k = (np.reshape(info.k, (3, 3)) * row_scale).ravel()
    small.p = (np.reshape(info.p, (3, 4)) * row_scale).ravel()
    return (picture if scale == 1 else np.asarray(cv2.resize(picture, None, fx=scale, fy=scale))), small


def cut(picture: Picture, info: CameraInfo, roi: list[int], decimation: int) -> tuple[Picture, CameraInfo]:
    """image_proc's crop_decimate: x, y, width, height (0: all), and of that each n-th pixel; K and P stay."""
    x, y = roi[:2]
    height, width = picture[y:, x:].shape[:2]
    width, height = roi[2] or width, roi[3] or height
    part = deepcopy(info)
    part.binning_x = part.binning_y = decimation
    part.roi.x_offset, part.roi.y_offset, part.roi.width, part.roi.height = x, y, width, height
    part.roi.do_rectify = (height, width) != picture.shape[:2]
    inside = picture[y : y + height, x : x + width]
    inside = inside[: height // decimation * decimation, : width // decimation * decimation]  # whole blocks
    return np.ascontiguousarray(inside[::decimation, ::decimation]), part


def pinhole(info: CameraInfo) -> NDArray[np.float64]:
    """P (3, 4) of the picture as it is published: image_geometry's, with roi and binning."""
    P = np.reshape(info.p, (3, 4)).copy()
    P[:2, 2] -= info.roi.x_offset, info.roi.y_offset
    P[:2] /= [[max(info.binning_x, 1)], [max(info.binning_y, 1)]]
    return P


def main() -> None:
    """Runs until it is interrupted."""
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(RectifyStill())


if __name__ == "__main__":
    main()
