"""Flights as coded video: packets of FFmpeg's encoders, in the messages that carry them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stab_ros.core.types import Image
from stab_ros.synthetic.flight import Shot

TOPIC = "/cam/video"
COMPRESSED_VIDEO = "foxglove_msgs/msg/CompressedVideo"
FFMPEG_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
DEFINITIONS = {
    COMPRESSED_VIDEO: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
    FFMPEG_PACKET: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
                   "bool is_bigendian\nuint8[] data\n",
}
STORE: Any = get_typestore(Stores.ROS2_JAZZY)
for _name, _text in DEFINITIONS.items():
    STORE.register(get_types_from_msg(_text, _name))
_OPTIONS = {
    "libx264": {"preset": "ultrafast", "bf": "0"},
    "libx265": {"preset": "ultrafast", "x265-params": "bframes=0:keyint=5:min-keyint=5:log-level=none"},
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8"},
    "libsvtav1": {"preset": "10"},
}
os.environ.setdefault("SVT_LOG", "1")  # errors only
KEY_EVERY = 5  # frames


@dataclass(frozen=True)
class Packet:
    """One packet, in the order of the encoder. number: of its picture in the flight."""

    number: int
    data: bytes


def encoded(shots: Sequence[Shot], encoder: str = "libx264", pixels: str = "yuv420p", **options: str) -> list[Packet]:
    """The packets of the flight, a key frame every five."""
    return encoded_images([shot.image for shot in shots], encoder, pixels, **options)


def encoded_images(images: Sequence[Image], encoder: str, pixels: str = "yuv420p", **options: str) -> list[Packet]:
    """The packets of images, grey or bgr8."""
    height, width = images[0].shape[:2]
    context = av.CodecContext.create(encoder, "w")
    assert isinstance(context, VideoCodecContext)
    context.width, context.height, context.pix_fmt = width, height, pixels
    context.time_base, context.framerate = Fraction(1, 25), Fraction(25)
    context.gop_size = KEY_EVERY
    context.options = {**_OPTIONS[encoder], **options}
    packets: list[Any] = []
    for number, image in enumerate(images):
        frame = av.VideoFrame.from_ndarray(image, "gray" if image.ndim == 2 else "bgr24")
        frame = frame.reformat(format=pixels)
        frame.pts = number
        packets += context.encode(frame)
    packets += context.encode(None)
    return [Packet(packet.pts or 0, bytes(packet)) for packet in packets]


def as_they_come(packets: Sequence[Packet]) -> list[Packet]:
    """The packets numbered in the order of the encoder: each is stamped as it comes, whatever picture is in it."""
    return [Packet(place, packet.data) for place, packet in enumerate(packets)]


def by_opencv(path: Path, packets: Iterable[Packet]) -> list[Image]:
    """The pictures of an elementary stream (path: *.h264 or *.h265), decoded by OpenCV's own FFmpeg."""
    path.write_bytes(b"".join(packet.data for packet in packets))
    return shown_by_opencv(path)


def shown_by_opencv(path: Path) -> list[Image]:
    """The pictures of a video file, decoded by OpenCV."""
    capture = cv2.VideoCapture(str(path))
    pictures: list[Image] = []
    while True:
        done, picture = capture.read()
        if not done:
            return pictures
        pictures.append(np.asarray(picture))


# messages -------------------------------------------------------------------------------------------------------------
Message = Callable[[Packet, int], bytes]  # of a packet and its stamp in ns


def _time(stamp_ns: int) -> Any:
    return STORE.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)


def compressed_video(video_format: str) -> Message:
    """foxglove_msgs/CompressedVideo in CDR."""
    def message(packet: Packet, stamp_ns: int) -> bytes:
        data = np.frombuffer(packet.data, np.uint8)
        made = STORE.types[COMPRESSED_VIDEO](_time(stamp_ns), "cam", data, video_format)
        return bytes(STORE.serialize_cdr(made, COMPRESSED_VIDEO))

    return message


def ffmpeg_packet(encoding: str) -> Message:
    """ffmpeg_image_transport_msgs/FFMPEGPacket in CDR."""
    def message(packet: Packet, stamp_ns: int) -> bytes:
        header = STORE.types["std_msgs/msg/Header"](_time(stamp_ns), "cam")
        data = np.frombuffer(packet.data, np.uint8)
        made = STORE.types[FFMPEG_PACKET](header, 480, 270, encoding, packet.number, 0, False, data)
        return bytes(STORE.serialize_cdr(made, FFMPEG_PACKET))

    return message


def compressed_image(image_format: str) -> Message:
    """sensor_msgs/CompressedImage in CDR."""
    def message(packet: Packet, stamp_ns: int) -> bytes:
        name = "sensor_msgs/msg/CompressedImage"
        header = STORE.types["std_msgs/msg/Header"](_time(stamp_ns), "cam")
        made = STORE.types[name](header, image_format, np.frombuffer(packet.data, np.uint8))
        return bytes(STORE.serialize_cdr(made, name))

    return message


def proto(*fields: tuple[int, int | bytes]) -> bytes:
    """A protobuf message of varints and bytes."""
    out = b""
    for number, value in fields:
        if isinstance(value, bytes):
            out += _varint(number << 3 | 2) + _varint(len(value)) + value
        else:
            out += _varint(number << 3) + _varint(value)
    return out


def _varint(value: int) -> bytes:
    out = b""
    while value >= 0x80:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def proto_time(stamp_ns: int) -> bytes:
    """A google.protobuf.Timestamp."""
    return proto((1, stamp_ns // 10**9), (2, stamp_ns % 10**9))


def protobuf_video(video_format: str) -> Message:
    """foxglove.CompressedVideo in protobuf."""
    return lambda packet, stamp_ns: proto(
        (1, proto_time(stamp_ns)), (2, b"cam"), (3, packet.data), (4, video_format.encode()))


def write_coded(path: Path, packets: Sequence[Packet], stamps_ns: Sequence[int], message: Message,
                msgtype: str = COMPRESSED_VIDEO, definition: str | None = None, topic: str = TOPIC) -> Path:
    """With mcap's own writer, logged in the order of the packets. stamps_ns: of the pictures, by number."""
    text = STORE.generate_msgdef(msgtype, ros_version=2)[0] if definition is None and "/" in msgtype else definition
    encoding, schema_encoding = ("cdr", "ros2msg") if "/" in msgtype else ("protobuf", "protobuf")
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(msgtype, schema_encoding, (text or "").encode())
        channel = writer.register_channel(topic, encoding, schema)
        for place, packet in enumerate(packets):
            log_time_ns = stamps_ns[place] + 2_000_000
            writer.add_message(channel, log_time_ns, message(packet, stamps_ns[packet.number]), log_time_ns)
        writer.finish()
    return path
