"""From velocities and depths at verticals to partial discharges: the velocity-area methods of ISO 748."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.discharge.wetted import wet_lengths_m

Integration: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def mid_section(chainage_m: FloatArray, depth_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """Partial discharge of each vertical: its velocity, times its depth, times half the wet width to both neighbours.

    ISO 748:2007, 7.2.3; USGS TM3-A8, equation 1. A shore counts as a vertical of depth 0; where the section ends
    under water, the end has half a width.

    Args:
        chainage_m: (N,).
        depth_m: (..., N), negative above the water.
        velocity_m_s: (..., N), depth-averaged, across the section.

    Returns:
        (..., N), m3/s.
    """
    half = wet_lengths_m(chainage_m, depth_m) / 2
    none = np.zeros_like(half[..., :1])
    width = np.concatenate([none, half], axis=-1) + np.concatenate([half, none], axis=-1)
    return np.asarray(velocity_m_s * np.maximum(depth_m, 0.0) * width)


def mean_section(chainage_m: FloatArray, depth_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """Partial discharges by the mean-section method: mean velocity, times mean depth, times width of each interval.

    ISO 748:2007, 7.2.2. At a shore, velocity and depth are 0. Of each interval, a vertical gets the part that its
    velocity brings.

    Args:
        chainage_m: (N,).
        depth_m: (..., N), negative above the water.
        velocity_m_s: (..., N), depth-averaged, across the section.

    Returns:
        (..., N), m3/s.
    """
    wet = np.maximum(depth_m, 0.0)
    half = wet_lengths_m(chainage_m, depth_m) * (wet[..., :-1] + wet[..., 1:]) / 4
    none = np.zeros_like(half[..., :1])
    per_velocity = np.concatenate([none, half], axis=-1) + np.concatenate([half, none], axis=-1)
    return np.asarray(np.where(depth_m > 0, velocity_m_s, 0.0) * per_velocity)


INTEGRATIONS: Mapping[str, Integration] = MappingProxyType({"mid_section": mid_section, "mean_section": mean_section})
