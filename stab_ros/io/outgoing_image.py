"""An image message that is allocated first, so that the image can be computed in place."""

from __future__ import annotations

from typing import Any

import numpy as np

from stab_ros.core.types import Image
from stab_ros.io.cdr import Header
from stab_ros.io.image_message import blank_image_cdr, image_cdr


class OutgoingImage:
    """One sensor_msgs/Image."""

    def __init__(self, encoding: str, header: Header) -> None:
        self._encoding, self._header = encoding, header
        self._data, self._pixels = b"", np.empty(0)

    def allocate(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Image:
        """An uninitialised image: inside the message if it is 8 bit, as bytes need no alignment."""
        if dtype.itemsize > 1:
            return np.empty(shape, dtype)
        self._data, self._pixels = blank_image_cdr(shape, dtype, self._encoding, self._header)
        return self._pixels

    def cdr(self, image: Image) -> bytes:
        """The message with `image`, which is not copied if it is the array that `allocate` returned."""
        return self._data if image is self._pixels else image_cdr(image, self._encoding, self._header)
