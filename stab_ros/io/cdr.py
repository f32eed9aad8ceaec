"""What all ROS messages have in common here: the typestore, CDR bytes, type names, headers and stamps.

Live (raw topics) and offline (bags) use the same bytes. One module per message: `image_message`, `camera_message`,
`homography_message`, `track_message`, `metrics_message`, `diagnostics_message`, `fix_message`, `attitude_message`,
`water_level_message`, `pose_message`, `twist_message`, `transform_message`, `marker_message`, `velocity_message`.
"""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import MessageError
from stab_ros.core.text import counted
from stab_ros.core.types import Frame
from stab_ros.io.xcdr2 import as_cdr, is_little_endian

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
FLOAT64 = "std_msgs/msg/Float64"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
IMU = "sensor_msgs/msg/Imu"
QUATERNION_STAMPED = "geometry_msgs/msg/QuaternionStamped"
POINT_STAMPED = "geometry_msgs/msg/PointStamped"
POSE_WITH_COVARIANCE_STAMPED = "geometry_msgs/msg/PoseWithCovarianceStamped"
TWIST_WITH_COVARIANCE_STAMPED = "geometry_msgs/msg/TwistWithCovarianceStamped"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"

SECOND_NS = 1_000_000_000
_ENCAPSULATION_BYTES, _STAMP_END = 4, 12


@functools.cache
def typestore() -> Typestore:
    """The message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True)
class Header:
    """std_msgs/Header.

    Raises:
        MessageError: the stamp does not fit a ROS time (32-bit seconds).
    """

    stamp_ns: int
    frame_id: str = ""

    def __post_init__(self) -> None:
        if not -(2**31) <= self.stamp_ns // SECOND_NS < 2**31:
            raise MessageError(f"stamp {self.stamp_ns} ns does not fit a ROS time, it must lie within 2^31 seconds")


def header_of(frame: Frame) -> Header:
    """The header of a frame, which every message derived from the frame carries."""
    return Header(frame.stamp_ns, frame.frame_id)


def header_message(header: Header) -> ros.std_msgs__msg__Header:
    """The header as a message of the typestore."""
    sec, nanosec = divmod(header.stamp_ns, SECOND_NS)
    stamp = ros.builtin_interfaces__msg__Time(sec=sec, nanosec=nanosec)
    return ros.std_msgs__msg__Header(stamp=stamp, frame_id=header.frame_id)


def read_stamp(cdr: bytes | memoryview) -> int:
    """The header stamp, ns, of any message that begins with a std_msgs/Header; the rest is not read.

    Raises:
        MessageError: too short for a header, or not a stamp.
    """
    if len(cdr) < _STAMP_END:
        raise MessageError(f"a message of {counted(len(cdr), 'byte')} does not begin with a header in CDR")
    sec, nanosec = struct.unpack_from("<iI" if is_little_endian(cdr) else ">iI", cdr, _ENCAPSULATION_BYTES)
    return to_ns(ros.builtin_interfaces__msg__Time(sec=sec, nanosec=nanosec))


def restamped(cdr: bytes, stamp_ns: int) -> bytes:
    """The same message with another header stamp, where it begins with a std_msgs/Header.

    Raises:
        MessageError: as `read_stamp`, or the stamp does not fit a ROS time.
    """
    read_stamp(cdr)
    stamp = struct.pack("<iI" if is_little_endian(cdr) else ">iI", *divmod(Header(stamp_ns).stamp_ns, SECOND_NS))
    return b"".join([cdr[:_ENCAPSULATION_BYTES], stamp, cdr[_STAMP_END:]])


def to_ns(stamp: ros.builtin_interfaces__msg__Time) -> int:
    """A stamp in ns.

    Raises:
        MessageError: a second or more in its nanoseconds.
    """
    if stamp.nanosec >= SECOND_NS:
        raise MessageError(f"header stamp has {stamp.nanosec} ns, it must have less than a second of them")
    return stamp.sec * SECOND_NS + stamp.nanosec


def serialize(message: object, msgtype: str) -> bytes:
    """CDR bytes of a message of the typestore."""
    return bytes(typestore().serialize_cdr(message, msgtype))


def deserialize(cdr: bytes | memoryview, msgtype: str, store: Typestore | None = None) -> object:
    """The message; its arrays are views of `cdr` if that is bytes, else of a copy, as views need immutable memory.

    store: which knows the type; None: that of Jazzy.

    Raises:
        MessageError: the bytes are no such message.
    """
    try:
        plain = as_cdr(cdr, msgtype, (store or typestore()).fielddefs)
        data = plain if isinstance(plain, bytes) else bytes(plain)
        return (store or typestore()).deserialize_cdr(memoryview(data), msgtype)  # rosbags slices the header off
    except (SerdeError, MessageError, KeyError) as error:
        raise MessageError(f"not a {msgtype}: {error}") from error
