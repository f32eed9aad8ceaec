"""The pixels of sensor_msgs/Image and CompressedImage as arrays; sizes are checked before anything is decoded.

The 8-bit colour conversions are those of rosbags-image; 16-bit pictures are scaled as cv_bridge does (65535 to 255).
"""

from __future__ import annotations

import struct
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
    """The picture, C-contiguous in native byte order, and its encoding; a view of the message's bytes where it can be.

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
    return _to_8_bit(convert_color(pixels, encoding, "bgr16"))


def _to_8_bit(image: Image) -> Image:
    return np.asarray(cv2.convertScaleAbs(image, alpha=_TO_8_BIT))


def _pixels(message: ImageMessage) -> NDArray[Any]:
    """The message's bytes as (h, w) or (h, w, channels), row padding and foreign byte order removed."""
    bits, _, _, channels = to_cvtype(message.encoding)
    _check_sizes(message, bits // 8 * channels)
    foreign = bits > 8 and bool(message.is_bigendian) != (sys.byteorder == "big")
    dtype = np.dtype(f"u{bits // 8}")
    item = dtype.itemsize
    raw: NDArray[Any] = np.ndarray(
        (message.height, message.width, channels), dtype.newbyteorder() if foreign else dtype, message.data,
        strides=(message.step, channels * item, item))
    # aligned too: the 16-bit values of a CDR message may start at an odd address
    whole = np.require(raw, dtype, ["C_CONTIGUOUS", "ALIGNED"])
    return whole[:, :, 0] if channels == 1 else whole


def _check_sizes(message: ImageMessage, pixel_bytes: int) -> None:
    w, h, step, n = message.width, message.height, message.step, len(message.data)
    _check_pixels(w, h)
    if step < w * pixel_bytes:
        raise MessageError(f"image step {step} is too small, {w} {message.encoding} pixels need {w * pixel_bytes}")
    if n != step * h:
        raise MessageError(f"image of {h} rows with step {step} holds {n} bytes, it must hold {step * h}")
    if message.encoding in _YUV and w % 2:
        raise MessageError(f"a {message.encoding} image must have an even width, this one has {w}")


def _check_pixels(width: int, height: int) -> None:
    if not (width > 0 and height > 0 and width * height <= MAX_PIXELS):
        raise MessageError(f"image of {width}x{height} pixels, it must have 1 to {MAX_PIXELS}")


def decode_compressed(data: NDArray[np.uint8]) -> Image:
    """A JPEG or PNG file (8 or 16 bit) as bgr8.

    Raises:
        MessageError: neither JPEG nor PNG, cut short, or too large.
    """
    _check_pixels(*_compressed_size(data.tobytes()))
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(data, flags)
    except cv2.error as error:
        raise MessageError(f"compressed image cannot be decoded: {error.err or error}") from error
    if image is None:
        raise MessageError("compressed image cannot be decoded, its JPEG or PNG data is damaged")
    return np.asarray(image) if image.dtype == np.uint8 else _to_8_bit(image)


def _compressed_size(data: bytes) -> tuple[int, int]:
    """Width and height by the file's own header, read before the decoder allocates anything."""
    if data.startswith(b"\x89PNG\r\n\x1a\n") and data[12:16] == b"IHDR" and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    if data.startswith(b"\xff\xd8"):
        return _jpeg_size(data)
    raise MessageError(f"compressed image starts with {data[:8]!r}, it must be JPEG or PNG")


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """From the frame header SOF0..15 (ITU-T T.81, B.2.2); the end marker is asked for as libjpeg fills up with grey."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], struct.unpack_from(">H", data, at + 2)[0]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            if data.find(b"\xff\xd9", at + length) < 0:
                raise MessageError("compressed image is cut short, its JPEG data has no end marker")
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        at += 2 + length if marker != 0xFF else 1  # 0xFF: fill byte before a marker
    raise MessageError("compressed image is damaged, its JPEG data has no frame header")
