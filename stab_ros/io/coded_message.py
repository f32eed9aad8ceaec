"""Messages that hold a packet of a video or a picture: those of Foxglove and of ffmpeg_image_transport."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import MessageError
from stab_ros.core.text import one_line
from stab_ros.io.bag_types import Topic
from stab_ros.io.cdr import SECOND_NS, Header, deserialize, header_message, to_ns
from stab_ros.io.protobuf import number_field, protobuf_fields
from stab_ros.io.ros1 import CONVERSION_ERRORS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

COMPRESSED_VIDEO = "foxglove_msgs/msg/CompressedVideo"
FFMPEG_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
_CODED = "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n"
# for bags without definitions, as ROS 2 wrote them before Iron
CDR_DEFINITIONS: Mapping[str, str] = {
    COMPRESSED_VIDEO: _CODED,
    "foxglove_msgs/msg/CompressedImage": _CODED,
    "foxglove_msgs/msg/RawImage": "builtin_interfaces/Time timestamp\nstring frame_id\nuint32 width\nuint32 height\n"
                                  "string encoding\nuint32 step\nuint8[] data\n",
    FFMPEG_PACKET: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
                   "bool is_bigendian\nuint8[] data\n",
}
# field numbers in Foxglove's .proto files
PROTOBUF_FIELDS: Mapping[str, Mapping[str, int]] = {
    "foxglove.CompressedVideo": {"timestamp": 1, "frame_id": 2, "data": 3, "format": 4},
    "foxglove.CompressedImage": {"timestamp": 1, "frame_id": 4, "data": 2, "format": 3},
    "foxglove.RawImage": {"timestamp": 1, "frame_id": 7, "width": 2, "height": 3, "encoding": 4, "step": 5, "data": 6},
}
_STORES = 16  # definitions whose types are kept; a bag has one or two


@dataclass(frozen=True, eq=False)
class CodedImage:
    """A picture file or a packet of a video. format: as the message says, such as "jpeg" or "libx264;yuv420p"."""

    header: Header
    format: str
    data: NDArray[np.uint8]


def read_coded(data: bytes, topic: Topic) -> CodedImage | ros.sensor_msgs__msg__Image:
    """The content of a message of a type of CDR_DEFINITIONS or, in protobuf, of PROTOBUF_FIELDS.

    Raises:
        MessageError: the message is damaged, or the topic's definition is not that of the type.
    """
    message = _of_protobuf(data, topic.msgtype) if topic.encoding == "protobuf" else _of_cdr(data, topic)
    try:
        header, octets = _header(message), _octets(message)
        if hasattr(message, "step"):
            return ros.sensor_msgs__msg__Image(header_message(header), message.height, message.width,
                                               message.encoding, 0, message.step, octets)
        coding = message.encoding if hasattr(message, "encoding") else message.format
        return CodedImage(header, str(coding), octets)
    except AttributeError as error:
        raise MessageError(f"{topic.msgtype} is defined otherwise in this recording: {error}") from error


def _header(message: Any) -> Header:
    header = getattr(message, "header", message)
    return Header(to_ns(header.stamp if header is not message else message.timestamp), header.frame_id)


def _octets(message: Any) -> NDArray[np.uint8]:
    data = message.data
    if not isinstance(data, np.ndarray) or data.dtype != np.uint8:
        raise MessageError("data is defined otherwise in this recording, it must be uint8[]")
    return data


# CDR ------------------------------------------------------------------------------------------------------------------
def _of_cdr(data: bytes, topic: Topic) -> Any:
    defined = topic.definition if topic.schema_encoding == "ros2msg" else ""
    return deserialize(data, topic.msgtype, _store(topic.msgtype, defined or CDR_DEFINITIONS[topic.msgtype]))


@functools.lru_cache(_STORES)
def _store(msgtype: str, definition: str) -> Typestore:
    """The types of Jazzy, and `msgtype` by its definition."""
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        store.register({msgtype: get_types_from_msg(definition, msgtype)[msgtype]})
    except CONVERSION_ERRORS as error:
        raise MessageError(f"the definition of {msgtype} cannot be read: {one_line(error)[:100]}") from error
    return store


# protobuf -------------------------------------------------------------------------------------------------------------
def _of_protobuf(data: bytes, msgtype: str) -> SimpleNamespace:
    found = protobuf_fields(data)
    return SimpleNamespace(**{
        name: _READ.get(name, _number)(found.get(number)) for name, number in PROTOBUF_FIELDS[msgtype].items()})


def _number(value: int | bytes | None) -> int:
    if isinstance(value, bytes):
        raise MessageError("a number is missing, this is another message")
    return value or 0


def _bytes(value: int | bytes | None) -> bytes:
    if isinstance(value, int):
        raise MessageError("a text, data or time is missing, this is another message")
    return value or b""


def _time(value: int | bytes | None) -> ros.builtin_interfaces__msg__Time:
    """A google.protobuf.Timestamp."""
    fields = protobuf_fields(_bytes(value))
    sec, nanosec = _number(fields.get(1)), _number(fields.get(2))
    if not (sec < 2**31 and nanosec < SECOND_NS):
        raise MessageError(f"stamp {sec} s, {nanosec} ns does not fit a ROS time")
    return ros.builtin_interfaces__msg__Time(sec, nanosec)


def protobuf_time(stamp_ns: int) -> bytes:
    """A google.protobuf.Timestamp. Both fields are there, so that it replaces any before it."""
    sec, nanosec = divmod(stamp_ns, SECOND_NS)
    return number_field(1, sec) + number_field(2, nanosec)


_READ: Mapping[str, Callable[[int | bytes | None], Any]] = {
    "timestamp": _time,
    "frame_id": lambda value: _bytes(value).decode(errors="replace"),
    "format": lambda value: _bytes(value).decode(errors="replace"),
    "encoding": lambda value: _bytes(value).decode(errors="replace"),
    "data": lambda value: np.frombuffer(_bytes(value), np.uint8),
}
