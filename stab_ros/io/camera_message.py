"""sensor_msgs/CameraInfo as camera drivers publish it: its size and K are those of the whole sensor (REP 104).

The image that is published is cut to `roi`, given in pixels of the sensor, and then binned. K follows as in
image_geometry's PinholeCameraModel: that shifts the principal point by the offset of the roi, and divides by the
binning without regard to half pixels.
"""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.geometry import shift
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import CAMERA_INFO, Header, deserialize, header_message, serialize


def read_camera(cdr: bytes | memoryview) -> Camera:
    """The camera in a CameraInfo: that of the image as published, after roi and binning.

    Raises:
        MessageError: damaged, uncalibrated, or with a roi that does not lie in the image.
    """
    message = cast(ros.sensor_msgs__msg__CameraInfo, deserialize(cdr, CAMERA_INFO))
    x, y, width, height = _roi(message)
    binning_x, binning_y = max(message.binning_x, 1), max(message.binning_y, 1)
    published_M_sensor = np.diag([1 / binning_x, 1 / binning_y, 1.0]) @ shift(-x, -y)
    try:
        whole = Camera(message.k.reshape(3, 3).copy(), message.d.copy(), message.distortion_model, (width, height))
        return dataclasses.replace(whole, K=published_M_sensor @ whole.K,
                                   size=(width // binning_x, height // binning_y))
    except InputError as error:
        raise MessageError(str(error)) from error


def _roi(message: ros.sensor_msgs__msg__CameraInfo) -> tuple[int, int, int, int]:
    """x, y, width and height, px of the sensor; all zero stands for all of it."""
    roi = message.roi
    x, y, width, height = roi.x_offset, roi.y_offset, roi.width, roi.height
    if not (x or y or width or height):
        return 0, 0, message.width, message.height
    if not (width and height and x + width <= message.width and y + height <= message.height):
        raise MessageError(f"camera_info: roi of {width}x{height} px at ({x}, {y}) does not lie in the "
                           f"{message.width}x{message.height} px of width and height, which must be those of the whole "
                           "sensor")
    return x, y, width, height


def camera_cdr(camera: Camera | None, size: tuple[int, int], header: Header) -> bytes:
    """CameraInfo of an image of `size`, width and height, px; None: of an uncalibrated camera, with K all zero."""
    K = np.zeros((3, 3)) if camera is None else np.asarray(camera.K, np.float64)
    D, model = (np.zeros(5), "plumb_bob") if camera is None else (np.asarray(camera.D, np.float64), camera.model)
    message = ros.sensor_msgs__msg__CameraInfo(
        header=header_message(header), height=size[1], width=size[0], distortion_model=model, d=D, k=K.ravel(),
        r=np.eye(3).ravel(), p=np.column_stack([K, np.zeros(3)]).ravel(), binning_x=0, binning_y=0,
        roi=ros.sensor_msgs__msg__RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False))
    return serialize(message, CAMERA_INFO)


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
