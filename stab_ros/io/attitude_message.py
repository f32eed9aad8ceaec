"""sensor_msgs/Imu and geometry_msgs/QuaternionStamped: an attitude in the map, of a gimbal or a drone's body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import MessageError
from stab_ros.core.text import one_line
from stab_ros.core.types import FloatArray
from stab_ros.io.cdr import IMU, QUATERNION_STAMPED, Header, deserialize, header_message, serialize, to_ns
from stab_ros.io.sensor_covariance import known_covariance

ATTITUDE_TYPES = (IMU, QUATERNION_STAMPED)
_LENGTH = 0.01  # that a quaternion may be longer or shorter than 1: single precision and rounded text
_OPTICAL = "_optical_frame"
_NO_ESTIMATE = -1.0  # as the first element of a covariance: sensor_msgs/Imu


@dataclass(frozen=True, eq=False)
class Attitude:
    """An attitude of a body (x forward, y left, z up) in a map whose axes are east, north and up (REP-103).

    Attributes:
        stamp_ns: when it was measured.
        map_q_body: (4,) float64, quaternion x, y, z, w of length 1; as it came where there is a fault.
        covariance_rad2: (3, 3) float64 of rotations about x, y and z; None: unknown.
        frame_id: of the body.
        fault: why it is no attitude, in words; empty: it is one.
        doubt: what it does not say, in words; empty: it says all.
    """

    stamp_ns: int
    map_q_body: FloatArray
    covariance_rad2: FloatArray | None = None
    frame_id: str = ""
    fault: str = ""
    doubt: str = ""


def read_attitude(cdr: bytes | memoryview, msgtype: str) -> Attitude:
    """The attitude in a message of one of ATTITUDE_TYPES; one that cannot be used says so in `fault`.

    Raises:
        MessageError: damaged, or of another type.
    """
    if msgtype == IMU:
        imu = cast(ros.sensor_msgs__msg__Imu, deserialize(cdr, IMU))
        missing = imu.orientation_covariance[0] == _NO_ESTIMATE
        return _attitude(imu.header, imu.orientation, imu.orientation_covariance,
                         "it measures no orientation (its orientation_covariance[0] is -1)" if missing else "")
    if msgtype == QUATERNION_STAMPED:
        stamped = cast(ros.geometry_msgs__msg__QuaternionStamped, deserialize(cdr, QUATERNION_STAMPED))
        return _attitude(stamped.header, stamped.quaternion, None)
    raise MessageError(f"{msgtype} holds no attitude, it must be {' or '.join(ATTITUDE_TYPES)}")


def _attitude(header: ros.std_msgs__msg__Header, quaternion: ros.geometry_msgs__msg__Quaternion,
              covariance: FloatArray | None, fault: str = "") -> Attitude:
    q = np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
    fault = fault or _fault(q)
    known, doubt = (None, "") if covariance is None or fault else known_covariance(covariance)
    doubts = ", ".join(filter(None, (doubt, "" if fault else _axes_doubt(header.frame_id))))
    return Attitude(to_ns(header.stamp), q if fault else q / np.linalg.norm(q), known, header.frame_id, fault, doubts)


def _axes_doubt(frame_id: str) -> str:
    """What is doubtful of the body's axes, by its name (REP-103: optical frames end so); "": nothing."""
    if not frame_id.endswith(_OPTICAL):
        return ""
    return (f"its frame_id {one_line(frame_id)[:60]} is that of an optical frame, it is taken for x forward, y left, z "
            "up")


def _fault(q: FloatArray) -> str:
    if not np.isfinite(q).all():
        return "its quaternion is not finite"
    if not q.any():
        return "its quaternion is all zero"
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(q))
    return "" if abs(length - 1) < _LENGTH else f"its quaternion has length {length:g}, it must be 1"


def imu_cdr(attitude: Attitude) -> bytes:
    """Imu with this orientation and, as its covariances say, neither rates nor accelerations."""
    unmeasured = np.array([_NO_ESTIMATE, *[0.0] * 8])
    C = attitude.covariance_rad2
    return serialize(ros.sensor_msgs__msg__Imu(
        header=header_message(Header(attitude.stamp_ns, attitude.frame_id)),
        orientation=quaternion_message(attitude.map_q_body),
        orientation_covariance=np.zeros(9) if C is None else np.array(C, np.float64).ravel(),
        angular_velocity=_zero(), angular_velocity_covariance=unmeasured,
        linear_acceleration=_zero(), linear_acceleration_covariance=unmeasured), IMU)


def quaternion_cdr(attitude: Attitude) -> bytes:
    """QuaternionStamped, which has no covariance."""
    return serialize(ros.geometry_msgs__msg__QuaternionStamped(
        header=header_message(Header(attitude.stamp_ns, attitude.frame_id)),
        quaternion=quaternion_message(attitude.map_q_body)), QUATERNION_STAMPED)


def quaternion_message(q: FloatArray) -> ros.geometry_msgs__msg__Quaternion:
    """A quaternion x, y, z, w."""
    x, y, z, w = map(float, q)
    return ros.geometry_msgs__msg__Quaternion(x=x, y=y, z=z, w=w)


def _zero() -> ros.geometry_msgs__msg__Vector3:
    return ros.geometry_msgs__msg__Vector3(x=0.0, y=0.0, z=0.0)
