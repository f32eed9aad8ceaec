"""Which topics of a recording hold images, and what one of their messages holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.text import one_line, reasons
from stab_ros.core.types import Frame
from stab_ros.io import cdr
from stab_ros.io.bag_types import Topic
from stab_ros.io.cdr import COMPRESSED_IMAGE, Header, deserialize, read_stamp, to_ns
from stab_ros.io.coded_message import (
    CDR_DEFINITIONS,
    COMPRESSED_VIDEO,
    FFMPEG_PACKET,
    PROTOBUF_FIELDS,
    CodedImage,
    protobuf_time,
    read_coded,
)
from stab_ros.io.compressed_image import decode_message
from stab_ros.io.decoded_image import decoded_frame
from stab_ros.io.encodings import decode_image
from stab_ros.io.image_message import IMAGE_TYPES, frame_of
from stab_ros.io.protobuf import bytes_field
from stab_ros.io.topics import STABILIZED_TOPIC
from stab_ros.io.video_decoder import decoder_of

_READABLE = frozenset({*((name, "cdr") for name in (*IMAGE_TYPES, *CDR_DEFINITIONS)),
                       *((name, "protobuf") for name in PROTOBUF_FIELDS)})
# how the names of topics end, after that of the raw image, by the plugin of image_transport
_TRANSPORTS = {COMPRESSED_IMAGE: ("/compressed", "/compressedDepth"), FFMPEG_PACKET: ("/ffmpeg",),
               COMPRESSED_VIDEO: ("/foxglove",)}
_LISTED = 5  # topics that an error names
_REPUBLISH = "play it through `ros2 run image_transport republish {} raw` and record that"
# what to do about images of a type that is not read
TO_DO: Mapping[str, str] = MappingProxyType({
    "theora_image_transport/msg/Packet": _REPUBLISH.format("theora"),
    "h264_msgs/msg/Packet": _REPUBLISH.format("h264"),
})


def holds_images(topic: Topic) -> bool:
    """Whether the messages of a topic are images, or coded video, that can be read."""
    return (topic.msgtype, topic.encoding) in _READABLE


def read_content(data: bytes, topic: Topic) -> Frame | CodedImage:
    """The frame in a message of a topic that holds images; of a coded video its packet.

    Raises:
        MessageError: the message is damaged, or of another type.
    """
    if topic.msgtype in IMAGE_TYPES:
        message = deserialize(data, topic.msgtype)
        return _video_in(message) or frame_of(message, topic.msgtype)
    coded = read_coded(data, topic)
    if isinstance(coded, ros.sensor_msgs__msg__Image):
        return Frame(*decode_image(coded), to_ns(coded.header.stamp), coded.header.frame_id)
    if topic.msgtype.endswith("CompressedImage") and not decoder_of(coded.format):
        image = decode_message(coded.data, coded.format)
        return decoded_frame(image, coded.header.stamp_ns, coded.header.frame_id)
    return coded


def _video_in(message: object) -> CodedImage | None:
    """The packet of a CompressedImage whose format is that of a video, as some cameras send it."""
    if not isinstance(message, ros.sensor_msgs__msg__CompressedImage) or not decoder_of(message.format):
        return None
    return CodedImage(Header(to_ns(message.header.stamp), message.header.frame_id), message.format, message.data)


def video_format(data: bytes, topic: Topic) -> str:
    """The format of the coded video whose packet a message holds, such as "h264"; empty: it holds a picture."""
    try:
        content = read_content(data, topic)
    except MessageError:
        return ""
    return one_line(content.format[:40]) if isinstance(content, CodedImage) else ""


def stamp_of(data: bytes, topic: Topic) -> int | None:
    """The header stamp, ns, also of a message whose image cannot be read; None: it has none."""
    try:
        if topic.encoding != "protobuf":
            return read_stamp(data)
        header = read_coded(data, topic).header
        return header.stamp_ns if isinstance(header, Header) else to_ns(header.stamp)
    except MessageError:
        return None


def restamped(data: bytes, stamp_ns: int, topic: Topic) -> bytes:
    """The same message of an image topic with another header stamp.

    Raises:
        MessageError: it has none, or the stamp does not fit a ROS time.
    """
    if topic.encoding != "protobuf":
        return cdr.restamped(data, stamp_ns)
    return data + bytes_field(PROTOBUF_FIELDS[topic.msgtype]["timestamp"], protobuf_time(stamp_ns))


def namespace_of(topic: Topic) -> str:
    """The camera's namespace: `/ns` for `/ns/image_raw`, `/ns/image_raw/compressed` and any other `/ns/name`.

    ROS knows no slash at the end of a name, nor two in a row, but recordings have them.
    """
    return _base_of(topic).rpartition("/")[0].rstrip("/")


def is_stabilized(topic: Topic) -> bool:
    """Whether it holds the tracker's pictures: `/ns/image_stabilized`, or the same by another image_transport."""
    return _base_of(topic).rpartition("/")[2] == STABILIZED_TOPIC


def _base_of(topic: Topic) -> str:
    """The name of the raw images, which image_transport's plugins append theirs to."""
    base = topic.name.rstrip("/")
    for ending in _TRANSPORTS.get(topic.msgtype, ()):
        base = base.removesuffix(ending)
    return base


def no_images(name: str, topics: Mapping[str, Topic], warnings: Iterable[str] = ()) -> InputError:
    """The error for a recording without images: what it holds instead, and what would be right.

    warnings: of the reader, whose damage may be the reason.
    """
    found = sorted(topics.values(), key=lambda topic: topic.name)
    shown = ", ".join(one_line(f"{topic.name} ({_kind(topic)})") for topic in found[:_LISTED])
    holds = f"only {shown}{' and others' * (len(found) > _LISTED)}" if found else "and no other topics"
    to_do = [f"; {TO_DO[topic.msgtype]}" for topic in found if topic.msgtype in TO_DO][:1]
    types = ", ".join((*IMAGE_TYPES, COMPRESSED_VIDEO, FFMPEG_PACKET))
    return InputError(f"{name}: holds no images{reasons(name, warnings)}, {holds}; it must have a topic of one of "
                      f"{types}{''.join(to_do)}")


def _kind(topic: Topic) -> str:
    kind = topic.msgtype or "no type"
    return kind if topic.encoding == "cdr" else f"{kind} in {topic.encoding or 'no encoding'}"
