"""The reference frame, and what can serve as one."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.gray import GreyRange
from stab_ros.core.types import Frame, Gray

SMALLEST_PX = 64  # a side of an image that can be tracked
_BLOCK_PX = 16  # of the quarter-size image
_LEAST_GRADIENT = 0.5  # squared, grey levels^2 per px^2 of the quarter-size image, where noise has averaged out
_LEAST_BLOCKS = 6


def is_textured(gray: Gray) -> bool:
    """Whether the image, (h, w) uint8, has enough texture: six blocks with gradients in both directions.

    The smaller eigenvalue of the structure tensor decides (Shi and Tomasi 1994), at a quarter of the size: 4x4 px are
    averaged there, and the noise of a flat or black image is gone.
    """
    if min(gray.shape) < SMALLEST_PX:
        return False
    small = cv2.resize(gray, (gray.shape[1] // 4, gray.shape[0] // 4), interpolation=cv2.INTER_AREA).astype(np.float32)
    dx, dy = cv2.Sobel(small, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(small, cv2.CV_32F, 0, 1, scale=1 / 8)
    xx, xy, yy = (cv2.blur(product, (_BLOCK_PX, _BLOCK_PX)) for product in (dx * dx, dx * dy, dy * dy))
    weaker = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    step = min(_BLOCK_PX, *(n // 4 for n in small.shape))
    return int(np.count_nonzero(weaker[step // 2 :: step, step // 2 :: step] > _LEAST_GRADIENT)) >= _LEAST_BLOCKS


@dataclass(frozen=True, eq=False)
class Reference:
    """The frame that all others are brought back to. shown: see `gray.grey_range`."""

    frame: Frame
    gray: Gray
    shown: GreyRange
