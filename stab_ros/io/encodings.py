"""The encodings of sensor_msgs/Image: from the pixels of a message to an array that a Frame can hold.

What a new encoding needs is listed in CONTRIBUTING.md, "Add an image encoding". Sizes are checked before anything is
decoded. The 8-bit colour conversions are those of rosbags-image; 16-bit colour is scaled to 8 bit as
cv_bridge does (65535 to 255).
"""

from __future__ import annotations

import sys
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.image.image import convert_color, to_cvtype

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Image

MAX_PIXELS = 2**28  # 16384 x 16384: a larger claim is an attack or a bug, not a camera
_BAYER = ("rggb", "bggr", "gbrg", "grbg")
_YUV = ("yuv422", "uyvy", "yuv422_yuy2", "yuyv")  # two pixels share their colour
# incoming encoding -> the encoding of the decoded frame
DECODED = {
    **{name: name for name in ("mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8")},
    "8UC1": "mono8", "8UC3": "bgr8", "8UC4": "bgra8", "16UC1": "mono16",
    **{f"bayer_{pattern}{depth}": "bgr8" for pattern in _BAYER for depth in (8, 16)},
    **dict.fromkeys(_YUV, "bgr8"),
    **dict.fromkeys(("bgr16", "rgb16", "bgra16", "rgba16"), "bgr8"),
}
_TO_8_BIT = 255.0 / 65535.0


class ImageMessage(Protocol):
    """The fields of sensor_msgs/Image that describe its pixels."""

    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: NDArray[np.uint8]


def decode_image(message: ImageMessage) -> tuple[Image, str]:
    """The image, C-contiguous in native byte order, and its encoding; a view of the message's bytes if possible.

    Raises:
        MessageError: unknown encoding, or sizes that contradict each other.
    """
    encoding = message.encoding
    if encoding not in DECODED:
        raise MessageError(f"image encoding {encoding[:40]!r} is unknown, it must be one of {', '.join(DECODED)}")
    pixels = _pixels(message)
    if DECODED[encoding] == encoding or encoding[0].isdigit():
        return pixels, DECODED[encoding]
    try:
        return _to_bgr8(pixels, encoding), "bgr8"
    except cv2.error as error:
        raise MessageError(f"a {encoding} image of {message.width}x{message.height} cannot be converted: "
                           f"{error.err or error}") from error


def _to_bgr8(pixels: Image, encoding: str) -> Image:
    if pixels.dtype == np.uint8:
        return convert_color(pixels, encoding, "bgr8")
    return to_8_bit(convert_color(pixels, encoding, "bgr16"))


def to_8_bit(image: Image) -> Image:
    """A 16-bit image as uint8, 65535 to 255."""
    return np.asarray(cv2.convertScaleAbs(image, alpha=_TO_8_BIT))


def _pixels(message: ImageMessage) -> NDArray[Any]:
    """The message's bytes as (h, w) or (h, w, channels), row padding and foreign byte order removed."""
    bits, _, _, channels = to_cvtype(message.encoding)
    _check_sizes(message, bits // 8, channels)
    foreign = bits > 8 and bool(message.is_bigendian) != (sys.byteorder == "big")
    dtype = np.dtype(f"u{bits // 8}")
    item = dtype.itemsize
    raw: NDArray[Any] = np.ndarray(
        (message.height, message.width, channels), dtype.newbyteorder() if foreign else dtype, message.data,
        strides=(message.step, channels * item, item))
    # aligned too: the 16-bit values of a CDR message may start at an odd address
    whole = np.require(raw, dtype, ["C_CONTIGUOUS", "ALIGNED"])
    return whole[:, :, 0] if channels == 1 else whole


def _check_sizes(message: ImageMessage, item: int, channels: int) -> None:
    """`item`: bytes of a value."""
    w, h, step, n = message.width, message.height, message.step, len(message.data)
    check_pixels(w, h)
    if step < w * item * channels:
        raise MessageError(f"image step {step} is too small, {w} {message.encoding} pixels need {w * item * channels}")
    if step % item:
        raise MessageError(f"image step {step} must be a multiple of {item}, the bytes of a {message.encoding} value")
    if n != step * h:
        raise MessageError(f"image data holds {n} bytes, it must hold {step * h}: height {h} with step {step}")
    if message.encoding in _YUV and w % 2:
        raise MessageError(f"image width {w} is odd, with encoding {message.encoding} it must be even")


def check_pixels(width: int, height: int) -> None:
    """Raises MessageError for an image without pixels, or with more than MAX_PIXELS."""
    if not (width > 0 and height > 0 and width * height <= MAX_PIXELS):
        raise MessageError(f"image width x height is {width}x{height} pixels, it must have 1 to {MAX_PIXELS}")
