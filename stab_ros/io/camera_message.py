"""sensor_msgs/CameraInfo as camera drivers publish it."""

from __future__ import annotations

from typing import cast

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import InputError, MessageError
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import CAMERA_INFO, deserialize


def read_camera(cdr: bytes | memoryview) -> Camera:
    """The camera in a CameraInfo.

    Raises:
        MessageError: damaged, uncalibrated, or of an image that was binned or cropped.
    """
    message = cast(ros.sensor_msgs__msg__CameraInfo, deserialize(cdr, CAMERA_INFO))
    roi, size = message.roi, (message.width, message.height)
    cropped = (roi.x_offset, roi.y_offset) != (0, 0) or (roi.width, roi.height) not in ((0, 0), size)
    if cropped or max(message.binning_x, message.binning_y) > 1:
        raise MessageError("camera_info: binning and roi are not supported, it must describe the image as published")
    try:
        return Camera(message.k.reshape(3, 3).copy(), message.d.copy(), message.distortion_model, size)
    except InputError as error:
        raise MessageError(str(error)) from error


def read_corrected(cdr: bytes | memoryview) -> tuple[tuple[int, int], Camera | None]:
    """Size of the reference, width and height, and the camera whose lens distortion was removed, of a `homography`.

    Returns:
        The size, px, and the camera; None: with K = I no distortion was removed.

    Raises:
        MessageError: as `read_camera`.
    """
    camera = read_camera(cdr)
    return camera.size, None if np.array_equal(camera.K, np.eye(3)) else camera


def is_of(camera: Camera, cdr: bytes) -> bool:
    """Whether a CameraInfo describes this camera; one that cannot be read describes none."""
    try:
        other = read_camera(cdr)
    except MessageError:
        return False
    return (other.model, other.size) == (camera.model, camera.size) and np.array_equal(
        other.K, camera.K) and np.array_equal(other.D, camera.D)


def read_size(cdr: bytes | memoryview) -> tuple[int, int] | None:
    """Width and height of a CameraInfo; None if they are not set.

    Raises:
        MessageError: damaged.
    """
    message = cast(ros.sensor_msgs__msg__CameraInfo, deserialize(cdr, CAMERA_INFO))
    return (message.width, message.height) if message.width and message.height else None
