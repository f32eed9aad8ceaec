"""geometry_msgs/PoseWithCovarianceStamped: where the camera is in the map, and where it looks."""

from __future__ import annotations

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.types import FloatArray
from stab_ros.imaging.pose import Pose
from stab_ros.io.attitude_message import quaternion_message
from stab_ros.io.cdr import POSE_WITH_COVARIANCE_STAMPED, Header, header_message, serialize


def pose_cdr(pose: Pose, covariance: FloatArray | None, header: Header) -> bytes:
    """The pose of the camera's optical frame in the frame of the header.

    covariance: (6, 6) of east, north, up, m, and rotations about the axes of the map, rad; None: unknown, all zero.
    """
    elements = np.zeros(36) if covariance is None else np.array(covariance, np.float64).ravel()
    place = ros.geometry_msgs__msg__Pose(
        position=point_message(pose.position_m), orientation=quaternion_message(pose.map_q_optical))
    return serialize(ros.geometry_msgs__msg__PoseWithCovarianceStamped(
        header=header_message(header),
        pose=ros.geometry_msgs__msg__PoseWithCovariance(pose=place, covariance=elements)), POSE_WITH_COVARIANCE_STAMPED)


def point_message(point_m: FloatArray) -> ros.geometry_msgs__msg__Point:
    """A point x, y, z."""
    x, y, z = map(float, point_m)
    return ros.geometry_msgs__msg__Point(x=x, y=y, z=z)
