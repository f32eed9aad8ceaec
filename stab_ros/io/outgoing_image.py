"""The message of a picture that is still to be made, so that it can be made in place."""

from __future__ import annotations

from typing import Any

import numpy as np

from stab_ros.core.types import Image
from stab_ros.io.messages import Header, blank_image_cdr, image_cdr


class OutgoingImage:
    """One sensor_msgs/Image."""

    def __init__(self, encoding: str, header: Header) -> None:
        self._encoding, self._header = encoding, header
        self._data, self._pixels = b"", np.empty(0)

    def allocate(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Image:
        """Room for the picture, not initialised: in the message where its values are bytes, which lie well anywhere."""
        if dtype.itemsize > 1:
            return np.empty(shape, dtype)
        self._data, self._pixels = blank_image_cdr(shape, dtype, self._encoding, self._header)
        return self._pixels

    def cdr(self, image: Image) -> bytes:
        """The message with `image`, which is not copied if it was made in `allocate`'s room."""
        return self._data if image is self._pixels else image_cdr(image, self._encoding, self._header)
