"""Frames as a node receives them: decoded from a message."""

from __future__ import annotations

import cv2
import numpy as np
from truth import picture, translation

from stab_ros.core.types import Frame, Image
from stab_ros.io.cdr import IMAGE, Header
from stab_ros.io.image_message import image_cdr, read_image

STEP_NS = 40_000_000


def seen(number: int, encoding: str = "mono8", size: tuple[int, int] = (320, 240)) -> Frame:
    """As a node receives it: mono8 is memory that cannot be written."""
    gray = picture(translation(0.7 * number, -0.4 * number), size)
    image: Image = gray.astype(np.uint16) * 200 if encoding == "mono16" else gray
    if encoding not in ("mono8", "mono16"):
        image = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGRA if encoding.endswith("a8") else cv2.COLOR_GRAY2BGR)
    return read_image(image_cdr(image, encoding, Header(10**9 + number * STEP_NS)), IMAGE)
