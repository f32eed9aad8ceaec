"""Windows of one frame, compared with another in which they are expected near known pixels."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.alignment import Aligned, Pose, align
from stab_ros.velocimetry.carried import Footprints
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import places_of
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.windows import Windows

_FAR_SHARE = 0.3  # of the block: what is found further away is not what was expected
_NOWHERE_PX = -1e6
# Prior of the second-order terms of the displacement at the border of a window, as a share of the displacement. For a
# parabolic profile of half width W and windows of half side r, r << W, they are (r / W)^2 of it.
_CURVATURE = 0.02


def compared(windows: Windows, which: IdArray, footprints: Footprints, frame: PlacedFrame, near_px: FloatArray,
             assumed_px: FloatArray, config: VelocityConfig, within_px: float) -> tuple[Aligned, BoolArray]:
    """Finds windows in a frame.

    Args:
        windows: of an earlier or later frame.
        which: (n,) of them.
        footprints: those of `which`.
        frame: in which they are sought.
        near_px: (n, 2), where they are expected.
        assumed_px: (n, 2, 6), by how much the flow is expected to have deformed them, see `alignment.Pose`.
        config: the settings.
        within_px: the search ends where nothing in the windows moves more.

    Returns:
        Where they are, and (n,) bool, which of them look alike and are near.
    """
    places_m = places_of(frame, near_px)
    carried = footprints.carried(frame, places_m)
    at_hand = np.asarray(np.isfinite(carried).all(axis=(1, 2)))
    pose = Pose(np.where(at_hand[:, None], near_px, _NOWHERE_PX), np.where(at_hand[:, None, None], carried, np.eye(2)),
                assumed_px)
    linear = config.shear_s * footprints.elapsed_s(frame) * windows.radius
    bent = _CURVATURE * np.nan_to_num(footprints.moved_px(places_m))
    sigma_px = np.stack([np.zeros_like(linear), linear, linear, bent, bent, bent], axis=1)
    aligned = align(windows, which, frame.gray, pose, sigma_px, within_px)
    off_px = np.hypot(*(aligned.pose.at_px - near_px).T)
    return aligned, at_hand & (aligned.correlation >= config.min_correlation) & (off_px < _FAR_SHARE * config.block_px)
