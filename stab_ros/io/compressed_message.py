"""sensor_msgs/CompressedImage as compressed_image_transport writes it: JPEG, PNG, or TIFF for 32-bit floats."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.types import Image
from stab_ros.io.cdr import COMPRESSED_IMAGE, Header, header_message, serialize

_TO_BGR = {"rgb8": cv2.COLOR_RGB2BGR, "rgba8": cv2.COLOR_RGBA2BGR, "bgra8": cv2.COLOR_BGRA2BGR}
_NO_DATA = np.empty(0, np.uint8)


@dataclass(frozen=True)
class Codec:
    """How images of 8 bit are compressed: name is jpeg or png, jpeg_quality 1 to 100, png_level 0 to 9."""

    name: str = "jpeg"
    jpeg_quality: int = 95
    png_level: int = 3

    def of(self, encoding: str) -> str:
        """The codec for images of an encoding: deeper ones keep their values, as PNG (16 bit) or TIFF (float)."""
        return {"mono16": "png", "32FC1": "tiff"}.get(encoding, self.name)

    def options(self, name: str) -> list[int]:
        """OpenCV's for the codec `name`."""
        by_name = {"jpeg": [cv2.IMWRITE_JPEG_QUALITY, self.jpeg_quality],
                   "png": [cv2.IMWRITE_PNG_COMPRESSION, self.png_level]}
        return by_name.get(name, [])


def compressed_cdr(image: Image, encoding: str, header: Header, codec: Codec) -> bytes:
    """CompressedImage of an image, (h, w) or (h, w, channels), of an encoding that image_stabilized can have.

    `format` names the encoding that image_transport's subscribers restore: `rgb8; jpeg compressed bgr8`.
    """
    name = codec.of(encoding)
    stored = np.asarray(cv2.cvtColor(image, _TO_BGR[encoding])) if encoding in _TO_BGR else image
    _, data = cv2.imencode(f".{name}", stored, codec.options(name))
    return _message(data, f"{encoding}; {name} compressed {_stored_as(name, stored)}", header)


def _stored_as(name: str, stored: Image) -> str:
    """The end of `format`: it is empty for grey PNG, and for TIFF."""
    if name == "tiff" or (name == "png" and stored.ndim == 2):
        return ""
    return "mono8" if stored.ndim == 2 else "bgr8"


def _message(data: NDArray[np.uint8], message_format: str, header: Header) -> bytes:
    """The data are appended, which is faster than the typestore."""
    message = ros.sensor_msgs__msg__CompressedImage(header_message(header), message_format, _NO_DATA)
    head = serialize(message, COMPRESSED_IMAGE)  # ends with the length of data, 0, in native byte order
    return b"".join([head[:-4], struct.pack("=I", data.size), data.tobytes()])
