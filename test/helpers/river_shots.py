"""A small river between banks that stand still, as a camera that does not move sees it: images for a recording."""

from __future__ import annotations

import numpy as np
from moving_texture_lspiv import MovingTexture

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.camera_path import Pose
from stab_ros.synthetic.flight import Shot

SIZE = (240, 160)
GSD_M, SPEED_M_S = 0.02, 1.0
SHORES_PX = (50, 110)  # rows between which the water flows to the right
_FIRST_NS = 10**9


def flow(y: FloatArray) -> FloatArray:
    """Velocity to the right, m/s, by metres above the lower border of the image."""
    row = SIZE[1] - y / GSD_M
    return np.where((row > SHORES_PX[0]) & (row < SHORES_PX[1]), SPEED_M_S, 0.0)


def river_shots(count: int) -> list[Shot]:
    """The first frames, 25 in a second."""
    scene = MovingTexture(flow, SIZE, GSD_M, seed=8)
    rows = np.arange(SIZE[1])[:, None] + np.zeros(SIZE[0])
    water = (rows > SHORES_PX[0]) & (rows < SHORES_PX[1])
    return [Shot(k, _FIRST_NS + frame.stamp_ns, np.ascontiguousarray(frame.gray), np.eye(3), Pose(), water)
            for k, frame in enumerate(scene.frames(count))]
