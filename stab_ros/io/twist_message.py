"""geometry_msgs/TwistWithCovarianceStamped: how the camera moves."""

from __future__ import annotations

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.camera_twist import Twist
from stab_ros.io.cdr import TWIST_WITH_COVARIANCE_STAMPED, Header, header_message, serialize


def twist_cdr(twist: Twist, header: Header) -> bytes:
    """The twist along the axes of the frame of the header, which is the optical frame of the camera."""
    moving = ros.geometry_msgs__msg__Twist(
        linear=vector_message(twist.linear_m_s), angular=vector_message(twist.angular_rad_s))
    covariance = np.array(twist.covariance, np.float64).ravel()
    return serialize(ros.geometry_msgs__msg__TwistWithCovarianceStamped(
        header=header_message(header),
        twist=ros.geometry_msgs__msg__TwistWithCovariance(twist=moving, covariance=covariance)),
        TWIST_WITH_COVARIANCE_STAMPED)


def vector_message(vector: FloatArray) -> ros.geometry_msgs__msg__Vector3:
    """A vector x, y, z."""
    x, y, z = map(float, vector)
    return ros.geometry_msgs__msg__Vector3(x=x, y=y, z=z)
