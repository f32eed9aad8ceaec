"""What of a section lies under water: depths, wet widths, channels and their shores."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray

DRY = -1  # the channel of a point above the water


def wet_lengths_m(chainage_m: FloatArray, depth_m: FloatArray) -> FloatArray:
    """Length under water of each interval between neighbouring points.

    A shore is where the line from bed point to bed point crosses the water surface.

    Args:
        chainage_m: (N,).
        depth_m: (..., N), negative above the water.

    Returns:
        (..., N - 1).
    """
    left, right = depth_m[..., :-1], depth_m[..., 1:]
    deeper, shallower = np.maximum(left, right), np.minimum(left, right)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(shallower >= 0, 1.0, deeper / (deeper - shallower))
    return np.asarray(np.diff(chainage_m) * np.where(deeper > 0, share, 0.0))


def area_m2(chainage_m: FloatArray, depth_m: FloatArray) -> FloatArray:
    """Wetted area, (...,), of depths (..., N)."""
    wet = np.maximum(depth_m, 0.0)
    return np.asarray((wet_lengths_m(chainage_m, depth_m) * (wet[..., :-1] + wet[..., 1:]) / 2).sum(axis=-1))


def channels(depth_m: FloatArray) -> IdArray:
    """Which channel each point lies in, (N,): 0, 1, ... from the start of the section, DRY above the water."""
    wet = np.asarray(depth_m) > 0
    starts = wet & ~np.concatenate([[False], wet[:-1]])
    return np.where(wet, np.cumsum(starts) - 1, DRY).astype(np.int64)


def channel_width_m(chainage_m: FloatArray, channel: BoolArray) -> float:
    """Width of a channel, from the point before it to that behind it, where there are any.

    channel: (N,), the points of the channel, which are consecutive.
    """
    inside = np.flatnonzero(channel)
    return float(chainage_m[min(inside[-1] + 1, len(chainage_m) - 1)] - chainage_m[max(inside[0] - 1, 0)])


def shores_m(chainage_m: FloatArray, depth_m: FloatArray, channel: BoolArray) -> FloatArray:
    """Chainages at which a channel meets its shore, at most two; none where the section ends under water.

    channel: (N,), the points of the channel, which are consecutive.
    """
    inside = np.flatnonzero(channel)
    first, last = int(inside[0]), int(inside[-1])
    found = []
    if first > 0:
        found.append(_crossing(chainage_m, depth_m, first, first - 1))
    if last < len(chainage_m) - 1:
        found.append(_crossing(chainage_m, depth_m, last, last + 1))
    return np.array(found)


def _crossing(chainage_m: FloatArray, depth_m: FloatArray, wet: int, dry: int) -> float:
    share = depth_m[wet] / (depth_m[wet] - depth_m[dry])
    return float(chainage_m[wet] + share * (chainage_m[dry] - chainage_m[wet]))
