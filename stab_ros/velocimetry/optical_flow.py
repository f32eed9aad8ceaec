"""Pyramidal Lucas-Kanade optical flow of points (Bouguet 2001, in OpenCV), with a forward-backward check."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray
from stab_ros.velocimetry.settings import VelocityConfig

_CONVERGED_PX = 0.005


def followed(first: Gray, second: Gray, points_px: FloatArray, guess_px: FloatArray,
             config: VelocityConfig) -> tuple[FloatArray, BoolArray]:
    """Points of one frame in another.

    Args:
        first: (h, w) uint8.
        second: (h, w) uint8.
        points_px: (N, 2) in the first.
        guess_px: (N, 2), where they are expected in the second.
        config: block, levels, iterations and largest forward-backward error.

    Returns:
        (N, 2) float64, where they are in the second, and (N,) bool, which of them were found and pass the check.
    """
    if not len(points_px):
        return points_px.copy(), np.zeros(0, bool)
    start, guess = points_px.astype(np.float32), guess_px.astype(np.float32)
    forward, ahead = _flow(first, second, start, guess, config)
    backward, behind = _flow(second, first, forward, start, config)
    off_px = np.hypot(*(backward - start).T)
    return forward.astype(np.float64), ahead & behind & (off_px <= config.max_bidirectional_px)


def _flow(first: Gray, second: Gray, points: FloatArray, guess: FloatArray,
          config: VelocityConfig) -> tuple[FloatArray, BoolArray]:
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, config.iterations, _CONVERGED_PX)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(first, second, points, guess.copy(), winSize=(config.block_px,) * 2,
                                                maxLevel=config.levels - 1, criteria=criteria,
                                                flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
    return moved, status.ravel().astype(bool)
