"""Windows of one frame, compared with another in which they are expected near known pixels."""

from __future__ import annotations

from dataclasses import replace

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
# parabolic profile of half width W and windows of half side r, r << W, they are (r / W)^2 of it. At the edge of the
# water, where there is shear and no velocity, they are up to half of the first-order ones. Most windows have far less:
# the variance has a prior of its own, scaled inverse chi^2 with one degree of freedom, so the terms that the frames
# before have shown say what it is in a window (Student's t as a scale mixture; Gelman et al. 2013, section 12.1).
_CURVATURE, _KINK = 0.02, 0.3
_SECOND_ORDER = 6  # second-order terms of both components
# Error of a displacement by what is beyond the second order, as a share of second-order terms that are not those of a
# smooth profile; measured at banks with the even seeds of bench/velocimetry/particles.py.
_HIGHER_ORDER = 0.15


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
    moved_px = np.nan_to_num(footprints.moved_px(places_m))
    linear = config.shear_s * footprints.elapsed_s(frame) * windows.radius
    aligned = align(windows, which, frame.gray, pose, _prior_px(linear, moved_px, assumed_px), within_px)
    edges = _of_higher_order(aligned.pose, moved_px)
    aligned = replace(aligned, covariance_px2=aligned.covariance_px2 + edges)
    off_px = np.hypot(*(aligned.pose.at_px - near_px).T)
    return aligned, at_hand & (aligned.correlation >= config.min_correlation) & (off_px < _FAR_SHARE * config.block_px)


def _prior_px(linear: FloatArray, moved_px: FloatArray, assumed_px: FloatArray) -> FloatArray:
    """(n, 6), standard deviations of the coefficients of the displacement before this frame is seen."""
    bent = _CURVATURE * moved_px + _KINK * _linear_px(assumed_px)
    squares = np.sum(assumed_px[:, :, 3:] ** 2, axis=(1, 2))
    bent = np.where(squares > 0, np.sqrt((bent**2 + squares) / (1 + _SECOND_ORDER)), bent)
    return np.stack([np.zeros_like(linear), linear, linear, bent, bent, bent], axis=1)


def _of_higher_order(pose: Pose, moved_px: FloatArray) -> FloatArray:
    """Covariance (n, 2, 2) of places, px^2, by terms of third order and above.

    They are there where terms of second order are larger than in any smooth profile: at the edge of the water.
    """
    usual_px = 3 * _CURVATURE * moved_px + _KINK / 2 * _linear_px(pose.bent_px)
    excess_px = np.maximum(np.sqrt(np.sum(pose.bent_px[:, :, 3:] ** 2, axis=2)) - usual_px[:, None], 0)
    spread = (_HIGHER_ORDER * excess_px)[:, :, None] ** 2 * np.eye(2)
    return np.asarray(pose.carried @ spread @ pose.carried.transpose(0, 2, 1))


def _linear_px(bent_px: FloatArray) -> FloatArray:
    """(n,), size of the first-order terms of the displacement."""
    return np.asarray(np.sqrt(np.sum(bent_px[:, :, 1:3] ** 2, axis=(1, 2))))
