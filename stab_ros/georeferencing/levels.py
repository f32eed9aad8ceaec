"""Where pixels meet the level planes through points."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.imaging.view import View


def on_own_level(view: View, image_px: FloatArray, map_m: FloatArray) -> FloatArray:
    """Where pixels meet the level planes through points.

    Args:
        view: the camera.
        image_px: (N, 2).
        map_m: (N, 3), of which the heights count.

    Returns:
        (N, 2), east and north; NaN where the ray does not meet the plane.
    """
    rays = view.camera.rays(image_px)
    directions = np.column_stack([rays, np.ones(len(rays))]) @ view.pose.cam_R_map
    rise = map_m[:, 2] - view.pose.position_m[2]
    meets = rise * directions[:, 2] > 0
    along = np.where(meets, rise / np.where(meets, directions[:, 2], 1), np.nan)
    return np.asarray(view.pose.position_m[:2] + directions[:, :2] * along[:, None])
