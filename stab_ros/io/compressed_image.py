"""sensor_msgs/CompressedImage: JPEG and PNG, checked before the decoder allocates anything."""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Image
from stab_ros.io.encodings import check_pixels, to_8_bit

MAX_DECODED = 2**27  # bytes of a compressed image, decoded: 45 Mpx in 8 bit; OpenCV takes twice as much on the way
_PNG_RATIO = 1032  # of deflate, which cannot pack more bytes into one
_JPEG_RATIO = 512  # pixels in a byte: a block of 64 takes a bit at least
_PNG, _JPEG, _SCAN, _END = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", 0xDA, b"\xff\xd9"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
_JPEG_FRAMES = (0xC0, 0xC1, 0xC2)  # baseline, extended, progressive: Huffman coded
_BARE_MARKERS = (0x00, 0x01, *range(0xD0, 0xDA))  # without a length, none of which may come before the first scan
_MAX_SCANS = 100  # of a progressive JPEG, each of which covers the whole image; 10 are usual


def decode_compressed(data: NDArray[np.uint8]) -> Image:
    """A JPEG or PNG file (8 or 16 bit) as bgr8.

    Raises:
        MessageError: neither JPEG nor PNG, cut short, or too large.
    """
    image = decode_file(data)
    return image if image.dtype == np.uint8 else to_8_bit(image)


def decode_file(data: NDArray[np.uint8]) -> Image:
    """A JPEG or PNG file as (h, w, 3), 8 or 16 bit as it is.

    Raises:
        MessageError: neither JPEG nor PNG, cut short, or too large.
    """
    _check_file(data.tobytes())
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(data, flags)
    except cv2.error as error:
        raise MessageError(f"compressed image data cannot be decoded: {error.err or error}") from error
    if image is None:
        raise MessageError("compressed image data cannot be decoded, the JPEG or PNG is damaged")
    return np.asarray(image)


def _check_file(data: bytes) -> None:
    """Checks the headers of the file, before the decoder allocates anything."""
    if data.startswith(_PNG) and data[12:16] == b"IHDR" and len(data) >= 26:
        _check_png(data)
    elif data.startswith(_JPEG):
        _check_jpeg(data)
    else:
        raise MessageError(f"compressed image data starts with {data[:8]!r}, it must be JPEG or PNG")


def _check_decoded(width: int, height: int, value_bytes: int) -> None:
    check_pixels(width, height)
    if width * height * 3 * value_bytes > MAX_DECODED:
        raise MessageError(f"image width x height is {width}x{height} pixels of {3 * value_bytes} bytes, a compressed "
                           f"image must not hold more than {MAX_DECODED} bytes")


def _check_png(data: bytes) -> None:
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    _check_decoded(width, height, 2 if bits > 8 else 1)
    _check_length(data, width, height, height * (width * bits * _PNG_CHANNELS.get(colour, 4) // 8) // _PNG_RATIO)
    at, kind = len(_PNG), b""
    while kind != b"IEND":
        kind, end = data[at + 4 : at + 8], at + 12 + int.from_bytes(data[at : at + 4], "big")
        if end > len(data):  # OpenCV would allocate whatever length a chunk claims
            raise MessageError(f"compressed image data is cut short, the PNG chunk at byte {at} ends at byte {end}")
        if kind == b"acTL":
            raise MessageError("compressed image data is an animated PNG, it must be a single image")
        at = end


def _check_jpeg(data: bytes) -> None:
    """By its markers (ITU-T T.81, B.2); the end marker is asked for as libjpeg fills up with grey."""
    frame: tuple[int, int, int, int] | None = None  # marker, height, width, components
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF and data[at + 1] not in _BARE_MARKERS:
        marker, length = data[at + 1], struct.unpack_from(">H", data, at + 2)[0]
        if marker == _SCAN and frame is not None:
            _check_scans(data, at + length, *frame, data[at + 4])
            return
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            if marker not in _JPEG_FRAMES or frame is not None:
                raise MessageError("compressed image data is no JPEG as cameras write it, it must be baseline or "
                                   "progressive")
            frame = (marker, *struct.unpack_from(">HHB", data, at + 5))
        at += 2 + length if marker != 0xFF else 1  # 0xFF: fill byte before a marker
    raise MessageError("compressed image data is damaged, the JPEG has no frame header")


def _check_scans(data: bytes, at: int, marker: int, height: int, width: int, components: int, in_scan: int) -> None:
    """`at`: where the first scan begins. With several scans libjpeg keeps 16 bits of every value until the last."""
    _check_decoded(width, height, 1 if marker < _JPEG_FRAMES[-1] and in_scan == components else 2)
    if data.find(_END, at) < 0:
        raise MessageError("compressed image data is cut short, the JPEG has no end marker")
    _check_length(data, width, height, width * height // _JPEG_RATIO)
    if data.count(bytes((0xFF, _SCAN)), at) > _MAX_SCANS:
        raise MessageError(f"compressed image data is a JPEG of more than {_MAX_SCANS} scans, it must have fewer")


def _check_length(data: bytes, width: int, height: int, least: int) -> None:
    if len(data) < least:
        raise MessageError(f"compressed image data of {len(data)} bytes is cut short, it cannot hold {width}x{height} "
                           "pixels")
