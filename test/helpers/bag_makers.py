"""A small flight and its recordings, for the tests of the readers and the writer."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.reader import make_reader
from mcap.records import Attachment, Metadata
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.msg import denormalize_msgtype

from stab_ros.io.bag import BagWriter, Message, Topic, open_bag, topic_of
from stab_ros.io.cdr import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, Header, header_of
from stab_ros.io.compressed_message import Codec, compressed_cdr
from stab_ros.io.image_message import image_cdr, read_image

START_NS = 1_700_000_000_000_000_000
FOREVER = "{sec: 9223372036, nsec: 854775807}"
QOS = ("- history: 1\n  depth: 10\n  reliability: 1\n  durability: 1\n"
       f"  deadline: {FOREVER}\n  lifespan: {FOREVER}\n  liveliness: 1\n  liveliness_lease_duration: {FOREVER}\n"
       "  avoid_ros_namespace_conventions: false")
STRING = "std_msgs/msg/String"
METADATA = ("rosbag2_bagfile_information:\n  relative_file_paths: [bag_0.mcap, bag_1.mcap, bag_2.mcap]\n"
            "  compression_mode: ''\n")
JAZZY: Any = get_typestore(Stores.ROS2_JAZZY)


def text_cdr(text: str) -> bytes:
    """A std_msgs/String."""
    return bytes(JAZZY.serialize_cdr(JAZZY.types[STRING](text), STRING))


def flight(count: int = 12) -> list[Message]:
    """Images of noise and texts, as a camera and a node would send them."""
    rng = np.random.default_rng(0)
    messages = []
    for i in range(count):
        stamp = START_NS + i * 40_000_000
        image = image_cdr(rng.integers(0, 256, (60, 80), np.uint8), "mono8", Header(stamp, "cam"))
        messages += [Message("/cam/image_raw", stamp + 3, stamp + 1, image),
                     Message("/notes", stamp + 5, stamp + 4, text_cdr(f"note {i} " + "x" * i))]
    return messages


FLIGHT = flight()
TOPICS = (topic_of("/cam/image_raw", IMAGE, QOS), topic_of("/notes", STRING), topic_of("/silent", CAMERA_INFO))


def written(path: Path, messages: list[Message] = FLIGHT, flush_every: int = 4) -> Path:
    """By our writer."""
    with BagWriter(path) as writer:
        for topic in TOPICS:
            writer.add_topic(topic)
        for number, message in enumerate(messages, start=1):
            writer.write(*message)
            if number % flush_every == 0:
                writer.flush_chunk()
    return path


def by_mcap(path: Path, messages: list[Message] = FLIGHT, **options: Any) -> Path:
    """By the library of the format."""
    with path.open("wb") as file:
        writer = Writer(file, **{"chunk_size": 20_000, **options})
        writer.start(profile="ros2")
        ids = {topic.name: writer.register_channel(
            topic.name, "cdr", writer.register_schema(topic.msgtype, "ros2msg", topic.definition.encode()),
            {"offered_qos_profiles": topic.qos}) for topic in TOPICS}
        for message in messages:
            writer.add_message(ids[message.topic], message.log_time_ns, message.data, message.publish_time_ns)
        writer.finish()
    return path


EXTRAS: tuple[Attachment | Metadata, ...] = (
    Attachment(name="calibration.yaml", media_type="application/yaml", create_time=5, log_time=6, data=b"fx: 800\n"),
    Metadata(name="flight", metadata={"site": "reach 4", "pilot": "Ödön", "": ""}),
    Attachment(name="calibration.yaml", media_type="", create_time=0, log_time=0, data=b""),
    Attachment(name="survey/Brücke 1.bin", media_type="x/y", create_time=1, log_time=2**64 - 1,
               data=bytes(range(256)) * 999),
    Metadata(name="flight", metadata={}),
)


def with_extras(source: Path, path: Path, extras: tuple[Attachment | Metadata, ...] = EXTRAS, **options: Any) -> Path:
    """The messages of `source` with extras among them, by the library of the format."""
    with source.open("rb") as old, path.open("wb") as new:
        writer = Writer(new, **{"chunk_size": 20_000, **options})
        writer.start(profile="ros2")
        channels, due = dict[int, int](), list(extras)
        for schema, channel, message in make_reader(old).iter_messages():
            if channel.id not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id, channel.metadata)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
            if due:
                _add(writer, due.pop(0))
        for extra in due:
            _add(writer, extra)
        writer.finish()
    return path


def _add(writer: Writer, extra: Attachment | Metadata) -> None:
    if isinstance(extra, Metadata):
        writer.add_metadata(extra.name, extra.metadata)
    else:
        writer.add_attachment(extra.create_time, extra.log_time, extra.name, extra.media_type, extra.data)


class Read(NamedTuple):
    """The content of a recording, by our reader."""

    messages: list[Message]
    warnings: list[str]
    topics: dict[str, Topic]


def read(path: Path, *topics: str) -> Read:
    """By our reader."""
    with open_bag(path) as reader:
        messages = list(reader.messages(topics or None))
        return Read(messages, list(reader.warnings), dict(reader.topics))


def without_publish_time(messages: list[Message]) -> list[Message]:
    """sqlite3 and ROS 1 have one time only."""
    return [message._replace(publish_time_ns=message.log_time_ns) for message in messages]


NOETIC: Any = get_typestore(Stores.ROS1_NOETIC)
CUSTOM = "river_msgs/msg/Gauge"
NOETIC.register(get_types_from_msg("std_msgs/Header header\nfloat64 level_m\nstring[] notes\n", CUSTOM))


def ros1_messages() -> list[tuple[str, str, object]]:
    """Topic, type and message: a common type, one with fields in capitals, one only this bag knows, a renamed one."""
    header = NOETIC.types["std_msgs/msg/Header"](
        seq=7, stamp=NOETIC.types["builtin_interfaces/msg/Time"](12, 34), frame_id="cam")
    roi = NOETIC.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return [
        ("/cam/image_raw", IMAGE, NOETIC.types[IMAGE](header, 2, 3, "mono8", 0, 3, np.arange(6, dtype=np.uint8))),
        ("/cam/camera_info", CAMERA_INFO, NOETIC.types[CAMERA_INFO](
            header, 2, 3, "plumb_bob", np.arange(5.0), np.arange(9.0), np.arange(9.0), np.arange(12.0), 0, 0, roi)),
        ("/gauge", CUSTOM, NOETIC.types[CUSTOM](header, 1.25, ["low", "murky"])),
    ]


def by_mcap_ros1(path: Path, spoil: bytes = b"", definition: bytes = b"", **options: Any) -> Path:
    """As `mcap convert` makes it of a ROS 1 bag. spoil: a message of each topic after the good one.

    definition: in place of the right ones.
    """
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros1", library="test")
        for number, (topic, msgtype, message) in enumerate(ros1_messages()):
            text = definition or NOETIC.generate_msgdef(msgtype, ros_version=1)[0].encode()
            schema = writer.register_schema(denormalize_msgtype(msgtype), "ros1msg", text)
            channel = writer.register_channel(topic, "ros1", schema)
            data = bytes(NOETIC.serialize_ros1(message, msgtype))
            writer.add_message(channel, START_NS + number, data, START_NS + number)
            if spoil:
                writer.add_message(channel, START_NS + 10 + number, spoil, START_NS + 10 + number)
        writer.finish()
    return path


def with_compressed(source: Path, path: Path, replaced: tuple[str, ...], kept: tuple[str, ...] = ()) -> Path:
    """The images of these topics as PNG, as compressed_image_transport writes them, beside those that are `kept`."""
    with open_bag(source) as bag, BagWriter(path) as writer:
        for name, topic in bag.topics.items():
            if name not in replaced or name in kept:
                writer.add_topic(topic)
        for name in replaced:
            writer.add_topic(topic_of(f"{name}/compressed", COMPRESSED_IMAGE))
        for message in bag.messages():
            times_ns = message.log_time_ns, message.log_time_ns
            if message.topic not in replaced or message.topic in kept:
                writer.write(message.topic, *times_ns, message.data)
            if message.topic in replaced:
                one = read_image(message.data, IMAGE)
                cdr = compressed_cdr(one.image, one.encoding, header_of(one), Codec("png"))
                writer.write(f"{message.topic}/compressed", *times_ns, cdr)
    return path
