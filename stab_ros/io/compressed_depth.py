"""compressedDepth of image_transport (compressed_depth_image_transport): 12 bytes, then a PNG of 16 bits."""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Image

_HEADER = struct.Struct("<iff")  # the kind of the codec, depthQuantA, depthQuantB
HEADER_BYTES = _HEADER.size


def is_compressed_depth(message_format: str) -> bool:
    """Whether the `format` of a CompressedImage names this transport, as `32FC1; compressedDepth png`."""
    return "compresseddepth" in message_format.lower()


def check_codec(message_format: str) -> None:
    """Raises MessageError for another codec than PNG."""
    if message_format.lower().rstrip().endswith("rvl"):
        raise MessageError("a compressedDepth image packed by RVL is not read, set the publisher's "
                           "compressedDepth.format to png")


def depth_of(png: Image, data: NDArray[np.uint8], message_format: str) -> Image:
    """The depth, (h, w).

    Args:
        png: (h, w) uint16, the decoded PNG.
        data: of the message, with its header.
        message_format: of the message, which names the encoding of the original: 16UC1 or 32FC1.

    Returns:
        16UC1 as it is; 32FC1, whose inverse was quantised, as float32, NaN where there are no data.

    Raises:
        MessageError: the header contradicts itself.
    """
    if not message_format.startswith("32FC1"):
        return png
    _, quant_a, quant_b = _HEADER.unpack_from(data.tobytes()[:HEADER_BYTES])
    if not (np.isfinite(quant_a) and np.isfinite(quant_b) and quant_a > 0):
        raise MessageError(f"a compressedDepth image has the quantisation {quant_a:g}, {quant_b:g}; it must be finite "
                           "and positive")
    known = (png > 0) & (png > quant_b)
    depth = np.full(png.shape, np.nan, np.float32)
    cv2.divide(quant_a, np.where(known, png - np.float32(quant_b), np.float32(1)), depth)
    return np.asarray(np.where(known, depth, np.float32(np.nan)))
