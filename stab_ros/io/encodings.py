"""The encodings of sensor_msgs/Image: from the pixels of a message to an array that a Frame can hold.

What a new encoding needs is listed in CONTRIBUTING.md, "Add an image encoding". Sizes are checked before anything is
decoded. The colour conversions are those of rosbags-image, which keep 16 bits.
"""

from __future__ import annotations

import re
import sys
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.image.image import convert_color, to_cvtype

from stab_ros.core.errors import MessageError
from stab_ros.core.text import counted
from stab_ros.core.types import Image

MAX_PIXELS = 2**28  # 16384 x 16384: a larger claim is an attack or a bug, not a camera
_BAYER = ("rggb", "bggr", "gbrg", "grbg")
_YUV = ("yuv422", "uyvy", "yuv422_yuy2", "yuyv")  # two pixels share their colour
# incoming encoding -> the encoding of the decoded frame
DECODED = {
    **{name: name for name in ("mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8")},
    "8UC1": "mono8", "8UC3": "bgr8", "8UC4": "bgra8", "16UC1": "mono16", "32FC1": "32FC1",
    **{f"bayer_{pattern}{depth}": f"bgr{depth}" for pattern in _BAYER for depth in (8, 16)},
    **dict.fromkeys(_YUV, "bgr8"),
    **dict.fromkeys(("bgr16", "rgb16", "bgra16", "rgba16"), "bgr16"),
}
_PLANAR = "let the driver publish bgr8 or yuv422_yuy2, or convert it by a node, as isaac_ros_image_proc does"
# what encodings of the field are not read, as patterns of the whole name, and what to do about each
_INSTEAD = {
    r"(nv|i|yv|yuv)_?(12|16|21|24|61|411|420).*": _PLANAR,
    r"(.*[^0-9])?(10|12|14)([^0-9].*)?": "let the driver publish whole 16-bit values, as mono16 or bayer_rggb16, or "
                                         "8-bit ones (its pixel format Mono16, BayerRG16 or Mono8)",
    r".*(jpe?g|h\.?26[45]|hevc|png).*": "pictures that are coded must come as sensor_msgs/CompressedImage, with "
                                        "image_transport:=compressed",
    r"(8S|16S|32S|64F)C1": "convert it to 16UC1 or 32FC1 by a node, as cv_bridge does",
    r"\d+[USF]C\d+": "convert it to bgr8, mono16 or 32FC1 by a node, as cv_bridge does",
}


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
        raise MessageError(f"image encoding {encoding[:40]!r} is not read, {_instead(encoding)}")
    pixels = _pixels(message)
    if DECODED[encoding] == encoding or encoding[0].isdigit():
        return pixels, DECODED[encoding]
    try:
        return convert_color(pixels, encoding, DECODED[encoding]), DECODED[encoding]
    except cv2.error as error:
        raise MessageError(f"a {encoding} image of {message.width}x{message.height} cannot be converted: "
                           f"{error.err or error}") from error


def _instead(encoding: str) -> str:
    """What to do about an encoding that is not read."""
    for pattern, advice in _INSTEAD.items():
        if re.fullmatch(pattern, encoding[:40], re.IGNORECASE):
            return advice
    return f"it must be one of {', '.join(DECODED)}"


def _pixels(message: ImageMessage) -> NDArray[Any]:
    """The message's bytes as (h, w) or (h, w, channels), row padding and foreign byte order removed."""
    bits, _, _, channels = to_cvtype(message.encoding)
    _check_sizes(message, bits // 8, channels)
    foreign = bits > 8 and bool(message.is_bigendian) != (sys.byteorder == "big")
    dtype = np.dtype(f"{'f' if 'F' in message.encoding else 'u'}{bits // 8}")
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
        raise MessageError(f"image data holds {counted(n, 'byte')}, it must hold {step * h}: height {h} with step "
                           f"{step}")
    if message.encoding in _YUV and w % 2:
        raise MessageError(f"image width {w} is odd, with encoding {message.encoding} it must be even")


def check_pixels(width: int, height: int) -> None:
    """Raises MessageError for an image without pixels, or with more than MAX_PIXELS."""
    if not (width > 0 and height > 0 and width * height <= MAX_PIXELS):
        raise MessageError(f"image width x height is {width}x{height} pixels, it must have 1 to {MAX_PIXELS}")
