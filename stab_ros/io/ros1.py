"""Topics and messages of ROS 1 as ROS 2 has them, through rosbags."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias

from rosbags.convert.converter import STATIC_MSGTYPE_RENAMES, is_same_wireformat, migrate_bytes
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from stab_ros.io.bag_types import Topic
from stab_ros.io.cdr import typestore

Conversion: TypeAlias = Callable[[bytes], bytes | memoryview]

# what rosbags lets through on damaged definitions and messages besides its own errors
CONVERSION_ERRORS = (
    SerdeError, TypesysError, struct.error, ValueError, LookupError, TypeError, AttributeError, AssertionError,
    RuntimeError, MemoryError, OverflowError, SyntaxError)
_HEADER = "std_msgs/msg/Header"


def ros1_topic(topic: Topic) -> tuple[Topic, Conversion]:
    """A topic of ROS 1, its type named as package/msg/Name, as ROS 2 has it, and how to get its messages into CDR.

    It gets the type of the same name in Jazzy, whose new fields get their defaults; else as it is defined.

    Raises:
        CONVERSION_ERRORS: the definition is damaged; so does the conversion for a damaged message.
    """
    source, target = get_typestore(Stores.EMPTY), typestore()
    types = get_types_from_msg(topic.definition, topic.msgtype)
    source.register(types)
    msgtype = STATIC_MSGTYPE_RENAMES.get(topic.msgtype, topic.msgtype)
    if msgtype not in target.fielddefs:
        target = get_typestore(Stores.EMPTY)
        target.register({**types, _HEADER: typestore().fielddefs[_HEADER]})  # ROS 1's has a sequence number
    definition, _ = target.generate_msgdef(msgtype, ros_version=2)
    converted = replace(topic, msgtype=msgtype, definition=definition, encoding="cdr", schema_encoding="ros2msg",
                        type_hash=target.hash_rihs01(msgtype))
    if is_same_wireformat(source, target, topic.msgtype, msgtype):
        return converted, partial(target.ros1_to_cdr, typename=msgtype)
    return converted, lambda data: migrate_bytes(
        source, target, topic.msgtype, msgtype, {}, data, src_is2=False, dst_is2=True)
