"""What other libraries write, in our reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import pytest
from bag_makers import (
    CUSTOM,
    FLIGHT,
    JAZZY,
    METADATA,
    NOETIC,
    QOS,
    START_NS,
    STRING,
    TOPICS,
    by_mcap,
    by_mcap_ros1,
    read,
    ros1_messages,
    text_cdr,
    without_publish_time,
)
from conftest import Command
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rclpy.serialization import deserialize_message
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import CameraInfo

from stab_ros.io.bag import BagWriter, definition_of, open_bag
from stab_ros.io.cdr import CAMERA_INFO, IMAGE
from stab_ros.io.image_message import read_image


# every format ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("options", [
    {"compression": CompressionType.NONE}, {"compression": CompressionType.LZ4}, {"compression": CompressionType.ZSTD},
    {"use_chunking": False}, {"index_types": IndexType.NONE}, {"use_statistics": False}, {"repeat_channels": False},
    {"repeat_schemas": False}, {"enable_crcs": False}, {"use_summary_offsets": False}, {"enable_data_crcs": True},
    {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False, "index_types": IndexType.NONE,
     "use_summary_offsets": False}], ids=str)
def test_every_way_mcap_writes(tmp_path: Path, options: dict[str, Any]) -> None:
    path = by_mcap(tmp_path / "a.mcap", **options)
    assert read(path)[:2] == (FLIGHT, [])
    assert read(path, "/notes").messages == FLIGHT[1::2]
    assert read(path).topics["/cam/image_raw"].definition == definition_of(IMAGE)


@pytest.mark.parametrize(("storage", "compression"), [
    (storage, compression)
    for storage in StoragePlugin for compression in (None, *CompressionMode)
    if compression != CompressionMode.NONE and
    (storage, compression) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)])  # rosbags has no such thing
@pytest.mark.parametrize("version", [8, 9])
def test_every_rosbag2_folder(
        tmp_path: Path, storage: StoragePlugin, compression: CompressionMode | None, version: Literal[8, 9]) -> None:
    writer = Writer2(tmp_path / "bag", version=version, storage_plugin=storage)
    if compression:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {t.name: writer.add_connection(t.name, t.msgtype, typestore=JAZZY) for t in TOPICS}
        for message in FLIGHT:
            writer.write(connections[message.topic], message.log_time_ns, message.data)
    found = read(tmp_path / "bag")
    assert found.messages == without_publish_time(FLIGHT)
    assert not found.warnings
    assert {(t.name, t.msgtype, t.count) for t in found.topics.values()} == {
        ("/cam/image_raw", IMAGE, 12), ("/notes", STRING, 12), ("/silent", CAMERA_INFO, 0)}
    assert get_types_from_msg(found.topics["/notes"].definition, STRING)[STRING] == JAZZY.fielddefs[STRING]
    assert read(tmp_path / "bag", "/notes").messages == without_publish_time(FLIGHT[1::2])
    assert read(tmp_path / "bag", "/silent").messages == []


@pytest.mark.parametrize("storage", StoragePlugin)
def test_rosbag2_folder_without_messages(tmp_path: Path, storage: StoragePlugin) -> None:
    with Writer2(tmp_path / "bag", version=9, storage_plugin=storage) as writer:
        writer.add_connection("/notes", STRING, typestore=JAZZY)
    assert read(tmp_path / "bag")[:2] == ([], [])
    with open_bag(tmp_path / "bag") as reader:
        assert (list(reader.topics), reader.start_ns, reader.end_ns) == (["/notes"], 0, 0)


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat])
def test_ros1_bag_comes_in_as_ros2(tmp_path: Path, compression: Writer1.CompressionFormat | None) -> None:
    writer = Writer1(tmp_path / "a.bag")
    if compression:
        writer.set_compression(compression)
    with writer:
        for number, (topic, msgtype, message) in enumerate(ros1_messages()):
            connection = writer.add_connection(topic, msgtype, typestore=NOETIC, latching=1)
            writer.write(connection, START_NS + number, NOETIC.serialize_ros1(message, msgtype))
    check_ros1(tmp_path / "a.bag")
    assert "durability: 1" in read(tmp_path / "a.bag").topics["/gauge"].qos  # latched


def test_ros1_in_an_mcap_comes_in_as_ros2(tmp_path: Path, command: Command) -> None:
    path = by_mcap_ros1(tmp_path / "a.mcap")
    check_ros1(path)
    assert command("convert", path, tmp_path / "ros2.mcap").returncode == 0
    check_ros1(tmp_path / "ros2.mcap")
    with (tmp_path / "ros2.mcap").open("rb") as file:
        kinds = {(schema.name, schema.encoding, channel.message_encoding)
                 for schema, channel, _ in make_reader(file).iter_messages() if schema}
    assert kinds == {(msgtype, "ros2msg", "cdr") for _, msgtype, _ in ros1_messages()}


def test_damage_in_an_mcap_of_ros1(tmp_path: Path) -> None:
    found = read(by_mcap_ros1(tmp_path / "a.mcap", spoil=b"\xff\xff\xff\xff"))
    assert len(found.messages) == 3
    assert len(found.warnings) == 3
    assert all("is damaged" in line and "it is left out" in line for line in found.warnings)
    undefined = read(by_mcap_ros1(tmp_path / "b.mcap", definition=b"float64[ x"))
    assert not undefined.messages
    assert len(undefined.warnings) == 3
    assert all("definition cannot be read" in line for line in undefined.warnings)


def test_recover_keeps_messages_of_ros1_byte_for_byte(tmp_path: Path, command: Command) -> None:
    path = by_mcap_ros1(tmp_path / "a.mcap")
    assert command("recover", path, tmp_path / "b.mcap").returncode == 0
    found = []
    for name in ("a.mcap", "b.mcap"):
        with (tmp_path / name).open("rb") as file:
            found.append([message.data for _, _, message in make_reader(file).iter_messages()])
    assert found[0] == found[1]
    check_ros1(tmp_path / "b.mcap")


def check_ros1(path: Path) -> None:
    """It holds `ros1_messages`, in CDR."""
    found = read(path)
    assert not found.warnings
    assert [(m.topic, m.log_time_ns) for m in found.messages] == [
        ("/cam/image_raw", START_NS), ("/cam/camera_info", START_NS + 1), ("/gauge", START_NS + 2)]
    frame = read_image(found.messages[0].data, IMAGE)
    assert (frame.image.tolist(), frame.stamp_ns, frame.frame_id) == ([[0, 1, 2], [3, 4, 5]], 12_000_000_034, "cam")
    camera_info = deserialize_message(found.messages[1].data, CameraInfo)
    assert (list(camera_info.d), list(camera_info.p)) == (list(range(5)), list(range(12)))
    assert found.topics["/cam/camera_info"].definition == definition_of(CAMERA_INFO)
    store: Any = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(found.topics["/gauge"].definition, CUSTOM))
    gauge = store.deserialize_cdr(found.messages[2].data, CUSTOM)
    assert (gauge.level_m, gauge.notes, gauge.header.stamp.sec) == (1.25, ["low", "murky"], 12)


def test_ros1_type_that_grew_in_ros2_gets_defaults(tmp_path: Path) -> None:
    msgtype = "diagnostic_msgs/msg/KeyValue"
    old: Any = get_typestore(Stores.EMPTY)
    old.register(get_types_from_msg("string key\n", msgtype))
    with Writer1(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/pair", msgtype, typestore=old)
        writer.write(connection, START_NS, old.serialize_ros1(old.types[msgtype]("k"), msgtype))
    (message,) = read(tmp_path / "a.bag").messages
    pair = JAZZY.deserialize_cdr(message.data, msgtype)
    assert (pair.key, pair.value) == ("k", "")


def test_foreign_bag_passes_through_byte_for_byte(shared_data: Path, tmp_path: Path) -> None:
    source, copy = shared_data / "rosbag2_2025_09_10-13_03_56_0.mcap", tmp_path / "copy.mcap"
    with open_bag(source) as reader, BagWriter(copy) as writer:
        for topic in reader.topics.values():
            writer.add_topic(topic)
        for message in reader.messages():
            writer.write(*message)
        assert not reader.warnings

    def contents(path: Path) -> tuple[dict[str, Any], list[Any]]:
        with path.open("rb") as file:
            mcap = make_reader(file, validate_crcs=True)
            summary = mcap.get_summary()
            assert summary is not None
            channels = {c.topic: (c.message_encoding, c.metadata, s.name, s.encoding, s.data)
                        for c in summary.channels.values() for s in [summary.schemas[c.schema_id]]}
            return channels, [(c.topic, m.log_time, m.publish_time, m.data) for _, c, m in mcap.iter_messages()]

    assert contents(copy) == contents(source)
    assert len(contents(copy)[0]) == 32


def test_other_encodings_pass_through_byte_for_byte(tmp_path: Path) -> None:
    source, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    schemas = [("acme.Binary", "protobuf", b"\x0a\xff\xfe\x00\x80"), ("acme.Json", "jsonschema", b"{}")]
    with source.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for number, schema in enumerate(schemas):
            channel = writer.register_channel(f"/t{number}", schema[1][:8], writer.register_schema(*schema))
            writer.add_message(channel, number, b"\x01\x02", number)
        writer.add_message(writer.register_channel("/bare", "raw", 0), 5, b"", 5)
        writer.finish()
    with open_bag(source) as reader, BagWriter(copy) as ours:
        for topic in reader.topics.values():
            ours.add_topic(topic)
        for message in reader.messages():
            ours.write(*message)
    with copy.open("rb") as file:
        found = [(s and (s.name, s.encoding, s.data), c.message_encoding, m.data)
                 for s, c, m in make_reader(file, validate_crcs=True).iter_messages()]
    assert found == [(schemas[0], "protobuf", b"\x01\x02"), (schemas[1], "jsonsche", b"\x01\x02"), (None, "raw", b"")]


def test_what_a_channel_says_of_itself_is_carried_over(tmp_path: Path, command: Command) -> None:
    """Several publishers make several channels of one topic; the first one speaks for it."""
    path, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    given = [{"offered_qos_profiles": QOS, "serial": "4711"}, {"offered_qos_profiles": "", "lens": "wide"}, {}]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(STRING, "ros2msg", definition_of(STRING).encode())
        for number, metadata in enumerate(given):
            channel = writer.register_channel("/notes", "cdr", schema, metadata)
            writer.add_message(channel, number, text_cdr("a"), number)
        writer.finish()
    assert command("convert", path, copy).returncode == 0
    with copy.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert [channel.metadata for channel in summary.channels.values()] == given[:1]
    assert [message.log_time_ns for message in read(copy).messages] == [0, 1, 2]


def test_second_type_of_a_topic_is_left_out_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for number, msgtype in enumerate([STRING, IMAGE, STRING]):
            schema = writer.register_schema(msgtype, "ros2msg", definition_of(msgtype).encode())
            writer.add_message(writer.register_channel("/notes", "cdr", schema), number, text_cdr("a"), number)
        writer.finish()
    found = read(path)
    assert [message.log_time_ns for message in found.messages] == [0, 2]
    assert (found.topics["/notes"].msgtype, found.topics["/notes"].count) == (STRING, 2)
    assert found.warnings == [f"{path}: /notes holds {STRING} and {IMAGE}, "
                              "the messages of the second type are left out"]


# split recordings -----------------------------------------------------------------------------------------------------
def split(folder: Path, metadata: str | None) -> Path:
    folder.mkdir()
    for number in range(3):
        by_mcap(folder / f"bag_{number}.mcap", FLIGHT[8 * number : 8 * number + 8])
    if metadata is not None:
        (folder / "metadata.yaml").write_text(metadata)
    return folder


def test_splits_are_one_recording(tmp_path: Path) -> None:
    found = read(split(tmp_path / "bag", METADATA))
    assert found[:2] == (FLIGHT, [])
    assert found.topics["/notes"].count == 12


@pytest.mark.parametrize("metadata", [None, "", "just text", "a: [", "rosbag2_bagfile_information: 3"])
def test_folder_whose_recorder_was_killed(tmp_path: Path, metadata: str | None) -> None:
    found = read(split(tmp_path / "bag", metadata))
    assert found.messages == FLIGHT
    assert found.warnings == [f"{tmp_path / 'bag'}: has no readable metadata.yaml, all its .mcap files were taken"]


def test_missing_and_damaged_splits_are_named(tmp_path: Path) -> None:
    folder = split(tmp_path / "bag", METADATA)
    (folder / "bag_0.mcap").unlink()
    (folder / "bag_2.mcap").write_bytes(b"")
    found = read(folder)
    assert found.messages == FLIGHT[8:16]
    assert found.warnings == [f"{folder / 'bag_0.mcap'}: is missing, its messages are lost",
                              f"{folder / 'bag_2.mcap'}: is empty, it must be an MCAP file"]


