"""Attitudes as drones tell them: heading clockwise from north, pitch upwards, roll to the right, in degrees.

These are the angles of aviation: of a body x forward, y right, z down against north, east and down, first the heading
about z, then the pitch about y, then the roll about x. DJI's gimbal angles are such: the yaw from north, a pitch of -90
at nadir.
"""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.types import FloatArray

_ENU_R_NED: FloatArray = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
_FRD_R_FLU: FloatArray = np.diag([1.0, -1, -1])  # right and down to left and up


def map_R_body(heading_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """Rotation (3, 3) from a body x forward, y left, z up to a map x east, y north, z up (both REP-103)."""
    ch, cp, cr = math.cos(heading_rad), math.cos(pitch_rad), math.cos(roll_rad)
    sh, sp, sr = math.sin(heading_rad), math.sin(pitch_rad), math.sin(roll_rad)
    ned_R_frd = np.array([
        [ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr],
        [sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr],
        [-sp, cp * sr, cp * cr],
    ])
    return np.asarray(_ENU_R_NED @ ned_R_frd @ _FRD_R_FLU)
