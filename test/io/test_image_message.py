"""sensor_msgs/Image: views and copies, byte order, contradictions and damage, against the real ROS 2 (rclpy)."""

from __future__ import annotations

import struct
from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import HEADER, complaint, damaged, random_pixels, ros_image
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Image

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import DIAGNOSTIC_ARRAY, IMAGE, read_stamp
from stab_ros.io.diagnostics_message import diagnostics_cdr
from stab_ros.io.image_message import image_cdr, read_image


def test_pixels_are_a_view_of_immutable_bytes_and_a_copy_of_others() -> None:
    cdr = serialize_message(ros_image(np.full((4, 6), 9, np.uint8), "mono8"))
    seen = read_image(cdr, IMAGE).image
    assert np.shares_memory(seen, np.frombuffer(cdr, np.uint8))
    assert not seen.flags.writeable
    reused = bytearray(cdr)
    kept = read_image(memoryview(reused), IMAGE).image
    reused[-24:] = bytes(24)
    assert (kept == 9).all()


def test_big_endian_cdr_is_read() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    cdr = image_cdr(np.arange(12, dtype=np.uint8).reshape(3, 4), "mono8", HEADER)
    swapped = bytes(store.serialize_cdr(store.deserialize_cdr(cdr, IMAGE), IMAGE, little_endian=False))
    frame = read_image(swapped, IMAGE)
    assert frame.stamp_ns == read_stamp(swapped) == HEADER.stamp_ns
    np.testing.assert_array_equal(frame.image.ravel(), np.arange(12))


@pytest.mark.parametrize("encoding", ["mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8"])
def test_image_is_byte_for_byte_what_ros_and_the_typestore_write(encoding: str) -> None:
    pixels = random_pixels(encoding, np.random.default_rng(3))
    cdr = image_cdr(pixels, encoding, HEADER)
    store = get_typestore(Stores.ROS2_JAZZY)
    assert cdr == bytes(store.serialize_cdr(store.deserialize_cdr(cdr, IMAGE), IMAGE))
    assert deserialize_message(cdr, Image) == ros_image(pixels, encoding)
    assert cdr == image_cdr(np.asfortranarray(pixels), encoding, HEADER)


SOUND = ros_image(np.full((4, 6), 9, np.uint8), "mono8")


def changed(**fields: object) -> bytes:
    message = Image(header=SOUND.header, **{
        name: fields.get(name, getattr(SOUND, name))
        for name in ("height", "width", "encoding", "is_bigendian", "step", "data")})
    return serialize_message(message)


@pytest.mark.parametrize(("fields", "says"), [
    ({"height": 100_000, "width": 100_000, "step": 100_000, "data": array("B", bytes(16))}, "100000x100000"),
    ({"height": 0, "data": array("B")}, "0 pixels|6x0"),
    ({"width": 0}, "0x4"),
    ({"width": 7}, "step 6"),
    ({"step": 7}, "must hold 28"),
    ({"step": 5}, "step 5"),
    ({"data": array("B", bytes(23))}, "holds 23 bytes"),
    ({"data": array("B", bytes(25))}, "holds 25 bytes"),
    ({"height": 2**31, "step": 2**31, "data": array("B", bytes(4))}, "pixels"),
    ({"encoding": ""}, "encoding ''"),
    ({"encoding": "64FC1"}, "64FC1"),
    ({"encoding": "mono8\n" * 100}, "encoding"),
    ({"encoding": "bgr8"}, "step 6"),
    ({"encoding": "8UC99999999999"}, "encoding"),
    ({"encoding": "yuyv", "width": 3}, "even"),
])
def test_messages_that_contradict_themselves_are_refused(fields: dict[str, object], says: str) -> None:
    with pytest.raises(MessageError, match=says) as caught:
        read_image(changed(**fields), IMAGE)
    assert len(str(caught.value).splitlines()) == 1


def test_encoding_that_is_not_utf8_is_refused() -> None:
    cdr = bytearray(changed())
    at = bytes(cdr).index(b"mono8")
    cdr[at : at + 5] = b"\xff\xfe\xfd\xfc\xfb"
    with pytest.raises(MessageError):
        read_image(bytes(cdr), IMAGE)


def test_stamp_beyond_a_second_is_refused() -> None:
    cdr = bytearray(changed())
    cdr[8:12] = struct.pack("<I", 10**9)
    for read in (lambda data: read_image(data, IMAGE), read_stamp):
        with pytest.raises(MessageError, match="less than a second"):
            read(bytes(cdr))


def test_image_of_another_type_is_refused() -> None:
    with pytest.raises(MessageError, match="not an image"):
        read_image(diagnostics_cdr(0, "a", "b", 0, "c", {}), DIAGNOSTIC_ARRAY)
    with pytest.raises(MessageError):
        read_image(changed(), "nobody/msg/Knows")


@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(data: st.DataObject) -> None:
    sound = changed()
    assert len(complaint(lambda cdr: read_image(cdr, IMAGE), data.draw(damaged(sound))).splitlines()) <= 1
