"""The data of sensor_msgs/CompressedImage, checked before the decoder allocates anything: JPEG, PNG, TIFF, WebP."""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Image
from stab_ros.io import compressed_depth, tiff_header, webp_header
from stab_ros.io.encodings import check_pixels

MAX_DECODED = 2**27  # bytes of a compressed image, decoded: 45 Mpx in 8 bit; OpenCV takes twice as much on the way
_PNG_RATIO = 1032  # of deflate, which cannot pack more bytes into one
_TIFF_RATIO = 4096  # of LZW: a code of 12 bits for a string as long as the table
_JPEG_RATIO = 512  # pixels in a byte: a block of 64 takes a bit at least
_PNG, _JPEG, _SCAN, _END = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", 0xDA, b"\xff\xd9"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
_JPEG_FRAMES = (0xC0, 0xC1, 0xC2)  # baseline, extended, progressive: Huffman coded
_BARE_MARKERS = (0x00, 0x01, *range(0xD0, 0xDA))  # without a length, none of which may come before the first scan
_OTHERS = {
    b"BM": "a BMP", b"GIF8": "a GIF", b"\0\0\0\x0cjP  ": "JPEG 2000", b"\xff\x4f\xff\x51": "JPEG 2000",
    b"\0\0\0\1": "a piece of coded video", b"\0\0\1": "a piece of coded video", b"OggS": "Theora video",
}
_MAX_SCANS = 100  # of a progressive JPEG, each of which covers the whole image; 10 are usual


def decode_message(data: NDArray[np.uint8], message_format: str) -> Image:
    """The data of a CompressedImage, by its `format`: (h, w, 3), or (h, w) for grey and depth; 8 or 16 bit as it is.

    Raises:
        MessageError: of another format, cut short, or too large.
    """
    if not compressed_depth.is_compressed_depth(message_format):
        return _decoded(data, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION)
    compressed_depth.check_codec(message_format)
    png = _decoded(data[compressed_depth.HEADER_BYTES :], cv2.IMREAD_UNCHANGED)
    if png.dtype != np.uint16 or png.ndim != 2:
        raise MessageError(f"a compressedDepth image holds {png.dtype.name} of shape {png.shape}, it must be a grey "
                           "PNG of 16 bits")
    return compressed_depth.depth_of(png, data, message_format)


def decode_file(data: NDArray[np.uint8]) -> Image:
    """A file as (h, w, 3), 8 or 16 bit as it is.

    Raises:
        MessageError: of another format, cut short, or too large.
    """
    return _decoded(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION)


def _decoded(data: NDArray[np.uint8], flags: int) -> Image:
    _check_file(data.tobytes())
    try:
        image = cv2.imdecode(data, flags)
    except cv2.error as error:
        raise MessageError(f"compressed image data cannot be decoded: {error.err or error}") from error
    if image is None:
        raise MessageError("compressed image data cannot be decoded, the file is damaged")
    return np.asarray(image)


def _check_file(data: bytes) -> None:
    """Checks the headers of the file, before the decoder allocates anything."""
    if data.startswith(_PNG) and data[12:16] == b"IHDR" and len(data) >= 26:
        _check_png(data)
    elif data.startswith(_JPEG):
        _check_jpeg(data)
    elif data.startswith(tiff_header.MAGIC):
        _check_tiff(data)
    elif webp_header.is_webp(data):
        _check_decoded(*webp_header.read_webp_size(data), value_bytes=1)
    else:
        raise MessageError(f"compressed image data {_named(data)}, it must be JPEG, PNG, TIFF or WebP; set the "
                           "publisher's format to jpeg or png")


def _named(data: bytes) -> str:
    """What the data are, for messages."""
    for start, name in _OTHERS.items():
        if data.startswith(start):
            return f"is {name}"
    return f"starts with {data[:8]!r}"


def _check_tiff(data: bytes) -> None:
    header = tiff_header.read_tiff_header(data)
    _check_decoded(header.width, header.height, header.bits // 8)
    _check_length(data, header.width, header.height, header.width * header.height * header.bits // 8 // _TIFF_RATIO)


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
