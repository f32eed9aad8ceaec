"""The motion of the camera between two frames: the constant twist that carries one pose to the other.

With T = [R, p] from the optical frame to the map, the twist x = log(T1^-1 T2) / (t2 - t1) in the optical frame takes
T1 to T2 = T1 exp(x (t2 - t1)): x is the mean over the interval, and the motion at its middle but for terms of second
order. Logarithm and derivatives: Barfoot, State Estimation for Robotics (2017), eqs. 7.77 to 7.95.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stab_ros.core.timeline import Advance, judge
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.placement import Placement
from stab_ros.georeferencing.pose_track import cross_matrix
from stab_ros.imaging.pose import Pose

_LONGEST_NS = 1_000_000_000  # the mean over a longer interval tells little of the motion at its end
_SMALL_RAD = 0.05  # below, series replace quotients of small numbers


@dataclass(frozen=True, eq=False)
class Twist:
    """How a camera moves.

    Attributes:
        linear_m_s: (3,), velocity of its projection centre in the map, along the axes of its optical frame (REP-103: x
            right, y down, z along the view).
        angular_rad_s: (3,), about these axes.
        covariance: (6, 6) of both, in this order, as in geometry_msgs/TwistWithCovariance.
    """

    linear_m_s: FloatArray
    angular_rad_s: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class Moment:
    """Where a frame lay. stamp_ns: when it was taken."""

    stamp_ns: int
    placement: Placement


def twist_between(before: Moment, after: Moment) -> Twist | None:
    """The twist from one frame to the next.

    Args:
        before: the earlier frame.
        after: the later one.

    Returns:
        The mean twist of the interval; None: the poses are not known with their covariance, or do not tell of motion
        (no `Placement.pose_link`, or another chain), or the stamps do not advance, or by more than a second.
    """
    first, second = before.placement, after.placement
    interval_ns = after.stamp_ns - before.stamp_ns
    if judge(after.stamp_ns, before.stamp_ns) is not Advance.STEADY or interval_ns > _LONGEST_NS:
        return None
    joint = _joint_covariance(first, second)
    if first.pose is None or second.pose is None or joint is None:
        return None
    x, J = logarithm(first.pose, second.pose)
    C, interval_s = J @ joint @ J.T, interval_ns / 1e9
    return Twist(x[:3] / interval_s, x[3:] / interval_s, (C + C.T) / 2 / interval_s**2)


def _joint_covariance(first: Placement, second: Placement) -> FloatArray | None:
    """(12, 12), of both poses; None: it is not known, or their difference is no motion."""
    one, other = first.pose_link, second.pose_link
    if one is None or other is None or one.chain != other.chain:
        return None
    if first.pose_covariance is None or second.pose_covariance is None:
        return None
    shared = other.shared(one)
    return np.block([[first.pose_covariance, shared.T], [shared, second.pose_covariance]])


def logarithm(first: Pose, second: Pose) -> tuple[FloatArray, FloatArray]:
    """log(T1^-1 T2) of two poses, and its derivative.

    Returns:
        (6,): translation, m, and rotation vector, rad, in the optical frame; (6, 12) of it by position and small
        rotations about the axes of the map, of the first pose and of the second.
    """
    to_first, way_m = first.cam_R_map, second.position_m - first.position_m
    turn = np.asarray(Rotation.from_matrix(to_first @ second.cam_R_map.T).as_rotvec())
    moved = to_first @ way_m
    inverse_J = _inverse_left_jacobian(turn)
    by_turn = inverse_J @ to_first
    D = _by_vector(turn, moved)
    J = np.zeros((6, 12))
    J[3:, 3:6], J[3:, 9:] = -by_turn, by_turn
    J[:3, :3], J[:3, 6:9] = -by_turn, by_turn
    J[:3, 3:6] = by_turn @ cross_matrix(way_m) - D @ by_turn
    J[:3, 9:] = D @ by_turn
    return np.concatenate([inverse_J @ moved, turn]), J


def _inverse_left_jacobian(turn: FloatArray) -> FloatArray:
    """(3, 3), 1 - [w] / 2 + c [w]^2 for a rotation vector w (3,)."""
    W, (c, _) = cross_matrix(turn), _quotients(float(np.linalg.norm(turn)))
    return np.asarray(np.eye(3) - W / 2 + c * W @ W)


def _by_vector(w: FloatArray, t: FloatArray) -> FloatArray:
    """Derivative (3, 3) of `_inverse_left_jacobian(w) @ t` by w."""
    c, growth = _quotients(float(np.linalg.norm(w)))
    twice = np.cross(w, np.cross(w, t))
    return np.asarray(cross_matrix(t) / 2 + c * ((w @ t) * np.eye(3) + np.outer(w, t) - 2 * np.outer(t, w))
                      + growth * np.outer(twice, w))


def _quotients(angle: float) -> tuple[float, float]:
    """The quotient c = (1 - a/2 cot a/2) / a^2 of an angle a, and its derivative by a, divided by a."""
    if angle < _SMALL_RAD:
        return 1 / 12 + angle**2 / 720 + angle**4 / 30240, 1 / 360 + angle**2 / 7560
    half = angle / 2
    c = (1 - half / math.tan(half)) / angle**2
    return c, ((half / math.sin(half) ** 2 - 1 / math.tan(half)) / (2 * angle**3)) - 2 * c / angle**2
