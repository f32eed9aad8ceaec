"""Coded video in recordings: each picture with the stamp of its own message, whatever the decoder does in between."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from coded_video import (
    COMPRESSED_VIDEO,
    DEFINITIONS,
    FFMPEG_PACKET,
    KEY_EVERY,
    STORE,
    TOPIC,
    Message,
    Packet,
    as_they_come,
    by_opencv,
    compressed_image,
    compressed_video,
    encoded,
    ffmpeg_packet,
    proto,
    proto_time,
    protobuf_video,
    write_coded,
)
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame
from stab_ros.io.bag import Topic
from stab_ros.io.bag_source import BagSource
from stab_ros.io.image_topic import read_content
from stab_ros.io.protobuf import protobuf_fields
from stab_ros.io.source import Clock, Picture, open_source, read_again
from stab_ros.synthetic.flight import Shot


@pytest.fixture(scope="module")
def stamps_ns(flight: list[Shot]) -> list[int]:
    return [shot.stamp_ns for shot in flight]


@pytest.fixture(scope="module")
def packets(flight: list[Shot]) -> list[Packet]:
    return encoded(flight)


def pictures(path: Path, topic: str | None = None) -> list[Picture]:
    with open_source(path, topic) as source:
        found = list(source.frames())
        assert len(found) == source.count
        return found


def skip_without(encoder: str) -> None:
    if encoder not in av.codecs_available:
        pytest.skip(f"this build of FFmpeg has no {encoder}")


def lost(found: Sequence[Picture]) -> dict[int, str]:
    """Why, by number."""
    return {number: str(picture.decoded) for number, picture in enumerate(found)
            if isinstance(picture.decoded, MessageError)}


def images(found: Sequence[Picture]) -> list[Any]:
    return [picture.decoded.image for picture in found if isinstance(picture.decoded, Frame)]


def difference(one: Any, other: Any) -> float:
    """Mean, in grey values."""
    assert one.shape == other.shape
    return float(np.abs(one.astype(float) - other).mean())


def check_same(found: Sequence[Any], expected: Sequence[Any]) -> None:
    """The colour conversion may differ in rounding; the next picture differs by several grey values."""
    assert len(found) == len(expected)
    assert max(map(difference, found, expected)) < 1


# formats and messages -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("encoder", "message", "msgtype"), [
    ("libx264", compressed_video("h264"), COMPRESSED_VIDEO),
    ("libx264", protobuf_video("h264"), "foxglove.CompressedVideo"),
    ("libx264", ffmpeg_packet("libx264"), FFMPEG_PACKET),
    ("libx264", ffmpeg_packet("h264_nvenc;yuv420p;bgr8;bgr8"), FFMPEG_PACKET),
    ("libx264", compressed_image("h264"), "sensor_msgs/msg/CompressedImage"),
    ("libx265", compressed_video("h265"), COMPRESSED_VIDEO),
    ("libx265", ffmpeg_packet("hevc_vaapi;nv12;bgr8;rgb8"), FFMPEG_PACKET),
    ("libvpx-vp9", compressed_video("vp9"), COMPRESSED_VIDEO),
    ("libsvtav1", protobuf_video("av1"), "foxglove.CompressedVideo"),
], ids=lambda one: one if isinstance(one, str) else "in")
def test_each_format_in_each_message(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, encoder: str, message: Message, msgtype: str) -> None:
    skip_without(encoder)
    bag = write_coded(tmp_path / "a.mcap", encoded(flight, encoder), stamps_ns, message, msgtype)
    found = pictures(bag)
    assert not lost(found)
    assert [picture.stamp_ns for picture in found] == stamps_ns
    frames = [picture.decoded for picture in found if isinstance(picture.decoded, Frame)]
    assert {(frame.size, frame.encoding, frame.frame_id) for frame in frames} == {((480, 270), "bgr8", "cam")}
    for picture, shot in zip(images(found), flight, strict=True):  # coded with loss
        assert difference(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), shot.image) < 10


@pytest.mark.parametrize(("encoder", "suffix"), [("libx264", "h264"), ("libx265", "h265")])
def test_pictures_are_those_of_another_decoder(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, encoder: str, suffix: str) -> None:
    stream = encoded(flight, encoder)
    bag = write_coded(tmp_path / "a.mcap", stream, stamps_ns, compressed_video(suffix))
    check_same(images(pictures(bag)), by_opencv(tmp_path / f"a.{suffix}", stream))


@pytest.mark.parametrize(("pixels", "encoding", "dtype"), [
    ("gray", "mono8", np.uint8), ("gray10le", "mono16", np.uint16), ("gray12le", "mono16", np.uint16)])
def test_video_without_colour_stays_so(flight: list[Shot], stamps_ns: list[int], tmp_path: Path, pixels: str,
                                       encoding: str, dtype: type) -> None:
    bag = write_coded(tmp_path / "a.mcap", encoded(flight[:2], "libx265", pixels), stamps_ns, compressed_video("h265"))
    (frame, _) = [picture.decoded for picture in pictures(bag)]
    assert isinstance(frame, Frame)
    assert (frame.encoding, frame.image.dtype.type) == (encoding, dtype)
    assert difference(frame.image / (257 if dtype is np.uint16 else 1), flight[0].image) < 10


@pytest.mark.parametrize("msgtype", [COMPRESSED_VIDEO, FFMPEG_PACKET])
@pytest.mark.parametrize("storage", StoragePlugin)
def test_rosbag2_folders_with_and_without_definitions(packets: list[Packet], stamps_ns: list[int], tmp_path: Path,
                                                      msgtype: str, storage: StoragePlugin) -> None:
    make = compressed_video("h264") if msgtype == COMPRESSED_VIDEO else ffmpeg_packet("h264")
    with Writer2(tmp_path / "bag", version=8, storage_plugin=storage) as writer:
        connection = writer.add_connection(TOPIC, msgtype, typestore=STORE)
        for packet, stamp_ns in zip(packets, stamps_ns, strict=True):
            writer.write(connection, stamp_ns, make(packet, stamp_ns))
    found = pictures(tmp_path / "bag")
    assert not lost(found)
    assert [picture.stamp_ns for picture in found] == stamps_ns
    bare = write_coded(tmp_path / "bare.mcap", packets, stamps_ns, make, msgtype, definition="")
    assert not lost(pictures(bare))


def test_a_ros1_bag_with_fields_in_another_order(packets: list[Packet], stamps_ns: list[int], tmp_path: Path) -> None:
    store: Any = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(  # of the package's first years
        "std_msgs/Header header\nuint8[] data\nint32 img_width\nint32 img_height\nstring encoding\nuint64 pts\n"
        "uint8 flags\n", FFMPEG_PACKET))
    with Writer1(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/cam/image_raw/ffmpeg", FFMPEG_PACKET, typestore=store)
        for packet, stamp_ns in zip(packets, stamps_ns, strict=True):
            header = store.types["std_msgs/msg/Header"](
                7, store.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9), "cam")
            message = store.types[FFMPEG_PACKET](
                header, np.frombuffer(packet.data, np.uint8), 480, 270, "libx264", packet.number, 0)
            writer.write(connection, stamp_ns, store.serialize_ros1(message, FFMPEG_PACKET))
    found = pictures(tmp_path / "a.bag")
    assert [picture.stamp_ns for picture in found if isinstance(picture.decoded, Frame)] == stamps_ns


# what decoders do -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("encoder", "suffix", "options"), [
    ("libx264", "h264", {"bf": "2", "preset": "medium"}),
    ("libx265", "h265", {"x265-params": "bframes=2:keyint=5:min-keyint=5:log-level=none"})])
def test_b_frames_are_given_as_shown_with_their_own_stamps(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, encoder: str, suffix: str,
        options: dict[str, str]) -> None:
    stream = encoded(flight, encoder, **options)
    assert [packet.number for packet in stream] != sorted(packet.number for packet in stream)
    bag = write_coded(tmp_path / "a.mcap", stream, stamps_ns, compressed_video(suffix))
    found = pictures(bag)
    assert not lost(found)
    assert [picture.stamp_ns for picture in found] == stamps_ns
    check_same(images(found), by_opencv(tmp_path / f"a.{suffix}", stream))
    with open_source(bag) as source:
        assert source.rate_hz() == pytest.approx(1e9 / (stamps_ns[1] - stamps_ns[0]), rel=0.01)


@pytest.mark.parametrize(("message", "msgtype"), [
    (compressed_video("h264"), COMPRESSED_VIDEO), (ffmpeg_packet("libx264"), FFMPEG_PACKET),
    (protobuf_video("h264"), "foxglove.CompressedVideo")], ids=["video", "ffmpeg", "protobuf"])
def test_stamps_of_packets_are_given_to_pictures_as_they_are_shown(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, message: Message, msgtype: str) -> None:
    stream = encoded(flight, bf="2", preset="medium")
    shown = images(pictures(write_coded(tmp_path / "own.mcap", stream, stamps_ns, message, msgtype)))
    bag = write_coded(tmp_path / "a.mcap", as_they_come(stream), stamps_ns, message, msgtype)
    with open_source(bag, None) as source:
        found = list(source.frames())
        assert source.warnings == []
    assert [picture.stamp_ns for picture in found] == stamps_ns
    assert [picture.decoded.stamp_ns for picture in found if isinstance(picture.decoded, Frame)] == stamps_ns
    assert np.array_equal(images(found), shown)


@pytest.mark.parametrize("by_ns", [500_000_000, 10**9, 10**18], ids=["little", "a loop", "to the time since boot"])
def test_a_clock_that_is_set_back_does_not_make_them_those_of_pictures(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, by_ns: int) -> None:
    set_ns = [stamp_ns + by_ns * (number < KEY_EVERY) for number, stamp_ns in enumerate(stamps_ns)]

    def message(packet: Packet, stamp_ns: int) -> bytes:
        return compressed_video("h264")(packet, set_ns[stamps_ns.index(stamp_ns)])

    stream = as_they_come(encoded(flight, bf="2", preset="medium"))
    found = pictures(write_coded(tmp_path / "a.mcap", stream, stamps_ns, message))
    assert not lost(found)
    found_ns = [picture.stamp_ns for picture in found]
    assert found_ns[KEY_EVERY:] == set_ns[KEY_EVERY:]
    assert found_ns == set_ns or by_ns < 10**9  # what the decoder holds then cannot be told from reordering


def test_the_log_time_of_a_message_without_a_stamp_does_not_either(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path) -> None:
    def message(packet: Packet, stamp_ns: int) -> bytes:
        return compressed_video("h264")(packet, stamp_ns - 10**18) if packet.number else b"?"

    stream = as_they_come(encoded(flight, bf="2", preset="medium"))
    logged_ns = [stamp_ns + 10**18 for stamp_ns in stamps_ns]  # of a camera whose clock began when it was switched on
    found = pictures(write_coded(tmp_path / "a.mcap", stream, logged_ns, message))
    assert set(lost(found)) == {*range(KEY_EVERY)}
    assert [picture.stamp_ns for picture in found] == [found[0].log_time_ns, *stamps_ns[1:]]


@pytest.mark.parametrize("steady", [False, True])
def test_log_times_of_b_frames_go_on_steadily(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, steady: bool) -> None:
    stream = encoded(flight, bf="2", preset="medium")
    bag = write_coded(tmp_path / "a.mcap", as_they_come(stream) if steady else stream, stamps_ns,
                      compressed_video("h264"))
    logged_ns = [stamp_ns + 2_000_000 for stamp_ns in stamps_ns]
    with open_source(bag, None, clock=Clock.LOG) as source:
        assert isinstance(source, BagSource)
        assert [picture.stamp_ns for picture in source.frames()] == logged_ns
        assert list(source.logged()) == list(zip(stamps_ns, logged_ns, strict=True))


@pytest.mark.parametrize("options", [{}, {"bf": "2", "preset": "medium"}], ids=["", "b-frames"])
def test_a_recording_that_begins_between_key_frames(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, options: dict[str, str]) -> None:
    stream = encoded(flight, **options)
    bag = write_coded(tmp_path / "a.mcap", stream[2:], stamps_ns, compressed_video("h264"))
    found = pictures(bag)
    assert set(lost(found)) == {*range(KEY_EVERY - 2)}
    assert "h264 video: no key frame has come before it" in lost(found)[0]
    check_same(images(found), by_opencv(tmp_path / "a.h264", stream)[KEY_EVERY:])
    assert [picture.stamp_ns for picture in found[KEY_EVERY - 2 :]] == stamps_ns[KEY_EVERY:]
    again = list(read_again(bag, None, None, Clock.HEADER, None, 6))
    assert [picture.stamp_ns for picture in again] == stamps_ns[8:]
    check_same(images(again), images(found)[-2:])


@pytest.mark.parametrize("encoder", ["libx264", "libx265", "libvpx-vp9", "libsvtav1"])
def test_pictures_after_a_damaged_packet_are_lost_up_to_the_next_key_frame(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, encoder: str) -> None:
    skip_without(encoder)
    options = {"svtav1-params": "pred-struct=1"} if encoder == "libsvtav1" else {}
    stream, name = encoded(flight, encoder, **options), {"libx264": "h264", "libx265": "h265", "libvpx-vp9": "vp9"}
    message = compressed_video(name.get(encoder, "av1"))
    whole = images(pictures(write_coded(tmp_path / "whole.mcap", stream, stamps_ns, message)))
    cuts = [[*stream[:2], Packet(2, stream[2].data[: len(stream[2].data) // part]), *stream[3:]]
            for part in (2, 3, 4, 6, 8, 12)]
    found = [pictures(write_coded(tmp_path / "a.mcap", cut, stamps_ns, message)) for cut in cuts]
    # the decoders of H.265 and VP9 now and then take what is left of a packet for a whole one
    noticed = [one for one in found if lost(one)]
    assert len(noticed) == len(cuts) if encoder == "libx264" else noticed
    for one in noticed:
        assert set(lost(one)) == {2, 3, 4}
        assert "the packet is damaged" in lost(one)[2]
        assert "it builds on a packet that is damaged" in lost(one)[4]
        assert [picture.stamp_ns for picture in one] == stamps_ns
        assert np.array_equal(images(one), [whole[number] for number in [0, 1, *range(5, 10)]])


def test_a_damaged_b_frame_is_no_fault_of_the_stamps(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path) -> None:
    stream = encoded(flight, bf="2", preset="medium")
    for at, packet in enumerate(stream[1:], 1):
        if packet.number > stream[at - 1].number:
            continue
        cut = Packet(packet.number, packet.data[: len(packet.data) // 3])
        bag = write_coded(tmp_path / "a.mcap", [*stream[:at], cut, *stream[at + 1 :]], stamps_ns,
                          compressed_video("h264"))
        with open_source(bag, None) as source:
            found = list(source.frames())
            assert lost(found)
            assert source.warnings == []
        assert sorted(picture.stamp_ns for picture in found) == stamps_ns


@pytest.mark.parametrize(("encoder", "options"), [
    ("libx264", {}), ("libx264", {"bf": "2", "preset": "medium"}), ("libx264", {"preset": "slow"}),
    ("libx264", {"x264-params": "cqm=jvt:8x8dct=1:keyint=5:ref=4:slices=3"}), ("libx265", {})])
def test_pictures_after_a_missing_packet_are_lost_up_to_the_next_key_frame(
        flight: list[Shot], stamps_ns: list[int], tmp_path: Path, encoder: str, options: dict[str, str]) -> None:
    if encoder == "libx265" and av.library_versions["libavcodec"][0] < 62:
        pytest.skip("FFmpeg before 8 does not notice it")
    stream, message = encoded(flight, encoder, **options), compressed_video(encoder)
    whole = {picture.stamp_ns: picture for picture in pictures(
        write_coded(tmp_path / "whole.mcap", stream, stamps_ns, message))}
    found = pictures(write_coded(tmp_path / "a.mcap", [stream[0], *stream[2:]], stamps_ns, message))
    assert sorted(picture.stamp_ns for picture in found) == sorted({*stamps_ns} - {stamps_ns[stream[1].number]})
    assert len(lost(found)) == KEY_EVERY - 2
    for picture in found:
        if isinstance(picture.decoded, Frame):
            assert np.array_equal(images([picture]), images([whole[picture.stamp_ns]]))


def test_a_message_that_cannot_be_read(packets: list[Packet], stamps_ns: list[int], tmp_path: Path) -> None:
    def message(packet: Packet, stamp_ns: int) -> bytes:
        whole = compressed_video("h264")(packet, stamp_ns)
        return {2: whole[:40], 3: b"?"}.get(packet.number, whole)

    found = pictures(write_coded(tmp_path / "a.mcap", packets, stamps_ns, message))
    assert set(lost(found)) == {2, 3, 4}
    assert f"not a {COMPRESSED_VIDEO}" in lost(found)[2]
    assert [picture.stamp_ns for picture in found] == [*stamps_ns[:3], found[3].log_time_ns, *stamps_ns[4:]]


def test_parameter_sets_in_a_message_of_their_own(packets: list[Packet], stamps_ns: list[int], tmp_path: Path) -> None:
    units = [unit for unit in re.split(b"\0?\0\0\1", packets[0].data) if unit]
    sets = [unit for unit in units if unit[0] & 31 in (7, 8)]  # SPS and PPS
    first = Packet(0, b"".join(b"\0\0\0\1" + unit for unit in sets))
    rest = Packet(1, b"".join(b"\0\0\0\1" + unit for unit in units if unit not in sets))
    stream = [first, rest, *(Packet(packet.number + 1, packet.data) for packet in packets[1:4])]
    found = pictures(write_coded(tmp_path / "a.mcap", stream, stamps_ns, compressed_video("h264")))
    assert set(lost(found)) == {0}


def test_an_empty_packet_costs_no_more_than_what_builds_on_it(
        packets: list[Packet], stamps_ns: list[int], tmp_path: Path) -> None:
    stream = [packets[0], Packet(1, b""), *packets[2:]]
    found = pictures(write_coded(tmp_path / "a.mcap", stream, stamps_ns, compressed_video("h264")))
    assert set(lost(found)) == {1, 2, 3, 4}
    assert lost(found)[1] == "h264 video: the packet is empty"


def test_the_format_may_change(flight: list[Shot], stamps_ns: list[int], packets: list[Packet], tmp_path: Path) -> None:
    def message(packet: Packet, stamp_ns: int) -> bytes:
        return compressed_video("h264" if packet.number < 5 else "h265")(packet, stamp_ns)

    stream = [*packets[:5], *encoded(flight, "libx265")[5:]]
    assert not lost(pictures(write_coded(tmp_path / "a.mcap", stream, stamps_ns, message)))


def test_unknown_format(packets: list[Packet], stamps_ns: list[int], tmp_path: Path) -> None:
    bag = write_coded(tmp_path / "a.mcap", packets, stamps_ns, compressed_video("prores\n"))
    with pytest.raises(InputError, match=r"video format 'prores\\n' cannot be decoded, it must be one of h264, h265"):
        pictures(bag)


# pictures of Foxglove -------------------------------------------------------------------------------------------------
def test_pictures_in_protobuf() -> None:
    image = np.arange(24, dtype=np.uint8).reshape(4, 6)
    jpeg = bytes(cv2.imencode(".jpg", np.full((8, 8), 90, np.uint8))[1])
    raw = proto((1, proto_time(5)), (7, b"cam"), (4, b"mono8"), (6, image.tobytes()))
    for number, value in ((2, 6), (3, 4), (5, 6)):  # width, height, step: fixed32
        raw += bytes([number << 3 | 5]) + value.to_bytes(4, "little")
    packed = proto((1, proto_time(7)), (4, b"cam"), (2, jpeg), (3, b"jpeg"))
    for msgtype, data, size, stamp_ns in (
            ("foxglove.RawImage", raw, (6, 4), 5), ("foxglove.CompressedImage", packed, (8, 8), 7)):
        frame = read_content(data, Topic("/a", msgtype, 1, "", encoding="protobuf", schema_encoding="protobuf"))
        assert isinstance(frame, Frame)
        assert (frame.size, frame.stamp_ns, frame.frame_id) == (size, stamp_ns, "cam")


@pytest.mark.parametrize(("data", "what"), [
    (b"\x0b", "wire type 3"), (b"\x0a\x05ab", "cut short"), (b"\xff" * 11, "no number"), (b"\x0d\x01", "cut short")])
def test_what_is_no_protobuf(data: bytes, what: str) -> None:
    with pytest.raises(MessageError, match=what):
        protobuf_fields(data)


def test_another_message_of_the_same_name() -> None:
    topic = Topic("/a", "foxglove.CompressedVideo", 1, "", encoding="protobuf", schema_encoding="protobuf")
    with pytest.raises(MessageError, match="another message"):
        read_content(proto((1, 1_700_000_000), (2, b"h264"), (3, b"data")), topic)
    other = Topic("/a", FFMPEG_PACKET, 1, "std_msgs/Header header\nfloat64[] data\nstring encoding\n")
    with pytest.raises(MessageError, match=r"not a|must be uint8"):
        read_content(ffmpeg_packet("h264")(Packet(0, b"0123456789abcdef"), 5), other)
    broken = Topic("/a", FFMPEG_PACKET, 1, "this is no definition !")
    with pytest.raises(MessageError, match=f"not a {FFMPEG_PACKET}"):
        read_content(ffmpeg_packet("h264")(Packet(0, b""), 5), broken)


# no images ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("name", "encoding", "said"), [
    ("theora_image_transport/msg/Packet", "cdr", "image_transport republish theora raw"),
    ("sensor_msgs/msg/PointCloud2", "cdr", "only /a (sensor_msgs/msg/PointCloud2)"),
    ("foxglove.CompressedImage", "json", "only /a (foxglove.CompressedImage in json)")])
def test_a_recording_without_images_says_what_it_holds(tmp_path: Path, name: str, encoding: str, said: str) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        channel = writer.register_channel("/a", encoding, writer.register_schema(name, "ros2msg", b""))
        writer.add_message(channel, 1, b"\0\1\0\0", 1)
        writer.finish()
    with pytest.raises(InputError) as caught, open_source(tmp_path / "a.mcap"):
        pass
    assert said in str(caught.value)
    assert COMPRESSED_VIDEO in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_definitions_of_the_readers_are_those_of_the_packages() -> None:
    from stab_ros.io.coded_message import CDR_DEFINITIONS

    assert {name: CDR_DEFINITIONS[name] for name in DEFINITIONS} == DEFINITIONS
