"""Water so far from static ground that windows there show none: a window that shows both follows the ground.

Where fast water touches ground, as beside an island, the ground wins, for it has the stronger contrast: velocities
there would be too small by any amount, and their own sigma does not tell.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray


def off_ground(ground: BoolArray, block_px: int) -> BoolArray:
    """(h, w) bool: where windows of `block_px` show water alone; all water, if it is nowhere so wide.

    Args:
        ground: (h, w) bool, static ground.
        block_px: side of the windows, px.
    """
    near = cv2.dilate(ground.astype(np.uint8), np.ones((block_px, block_px), np.uint8)) > 0
    return np.asarray(~ground if near.all() else ~near)
