"""From a decoded array, as OpenCV and other readers of files return it, to a frame; nothing of its range is lost."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Frame, Image

_ENCODINGS = {
    (1, "uint8"): "mono8", (3, "uint8"): "bgr8", (4, "uint8"): "bgra8",
    (1, "uint16"): "mono16", (3, "uint16"): "bgr16", (4, "uint16"): "bgr16",
    (1, "float32"): "32FC1",
}


def decoded_frame(pixels: NDArray[Any], stamp_ns: int, frame_id: str = "") -> Frame:
    """A decoded image as a frame.

    Args:
        pixels: (h, w), or (h, w, channels) with 1 channel (grey), 2 (grey, alpha), 3 (BGR) or 4 (BGRA); bool, uint8
            or uint16. One channel may be signed or floating, too: values that are not finite are no data.
        stamp_ns: the header stamp, ns.
        frame_id: the header's coordinate frame.

    Returns:
        mono8, bgr8, bgra8, mono16, bgr16 (without alpha) or 32FC1, C-contiguous.

    Raises:
        MessageError: other pixels.
    """
    image = _of_known_type(_without_grey_alpha(pixels))
    channels = image.shape[2] if image.ndim == 3 else 1
    encoding = _ENCODINGS.get((channels, image.dtype.name)) if image.ndim in (2, 3) and image.size else None
    if encoding is None:
        raise MessageError(f"pixels of type {pixels.dtype.name} and shape {pixels.shape} cannot be used, they must be "
                           "8 or 16 bit, grey or colour, or 32-bit float in one channel")
    kept = image[:, :, :3] if encoding == "bgr16" else image
    return Frame(np.ascontiguousarray(kept), encoding, stamp_ns, frame_id)


def _without_grey_alpha(pixels: NDArray[Any]) -> NDArray[Any]:
    """One channel and one of grey and alpha as (h, w)."""
    return pixels[:, :, 0] if pixels.ndim == 3 and pixels.shape[2] in (1, 2) else pixels


def _of_known_type(image: NDArray[Any]) -> Image:
    """Bits as 0 and 255, signed and floating values as float32, and native byte order."""
    if image.dtype == np.bool_:
        return image.astype(np.uint8) * np.uint8(255)
    if image.dtype.kind == "f" or image.dtype in (np.int8, np.int16):
        return image.astype(np.float32)
    return image.astype(image.dtype.newbyteorder("="), copy=False)
