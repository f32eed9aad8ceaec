"""Pictures as drivers, cameras and attackers send them, against the real ROS 2 (rclpy) and OpenCV."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import HEADER, complaint, damaged, random_pixels, ros_image
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CompressedImage, Image

from stab_ros.core.errors import MessageError
from stab_ros.io import messages as m
from stab_ros.io.encodings import DECODED


# images in ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("padding", [0, 3, 4])  # of 16 bit, whole values
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize(
    "encoding", ["mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8", "8UC1", "8UC3", "8UC4", "16UC1"])
def test_plain_encodings_come_in_as_they_are(encoding: str, big_endian: bool, padding: int) -> None:
    pixels = random_pixels(encoding, np.random.default_rng(1))
    frame = m.read_image(serialize_message(ros_image(pixels, encoding, padding * pixels.itemsize, big_endian)), m.IMAGE)
    np.testing.assert_array_equal(frame.image, pixels)
    assert frame.image.dtype == pixels.dtype
    assert frame.image.flags.c_contiguous
    assert frame.image.flags.aligned
    assert (frame.encoding, frame.stamp_ns, frame.frame_id) == (DECODED[encoding], HEADER.stamp_ns, "camera")


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_gives_back_the_colour_it_was_made_of(pattern: str, depth: int) -> None:
    colour = {"b": 30, "g": 120, "r": 200}
    mosaic = np.array([[colour[pattern[0]], colour[pattern[1]]], [colour[pattern[2]], colour[pattern[3]]]])
    pixels = np.tile(mosaic, (8, 10)).astype(np.uint8)
    stored = pixels if depth == 8 else pixels.astype(np.uint16) * 257
    frame = m.read_image(serialize_message(ros_image(stored, f"bayer_{pattern}{depth}")), m.IMAGE)
    assert frame.encoding == "bgr8"
    np.testing.assert_array_equal(frame.image, np.broadcast_to(list(colour.values()), (16, 20, 3)))


@pytest.mark.parametrize(("encoding", "order"), [
    ("yuv422", "uyvy"), ("uyvy", "uyvy"), ("yuv422_yuy2", "yuyv"), ("yuyv", "yuyv")])
def test_yuv422_follows_bt601(encoding: str, order: str) -> None:
    red = {"y": 81, "u": 90, "v": 240}  # ITU-R BT.601, limited range
    row = np.array([red[letter] for letter in order] * 4, np.uint8).reshape(1, 8, 2)
    frame = m.read_image(serialize_message(ros_image(np.repeat(row, 5, axis=0), encoding)), m.IMAGE)
    assert frame.encoding == "bgr8"
    np.testing.assert_allclose(frame.image, np.broadcast_to([0, 0, 255], (5, 8, 3)), atol=2)


@pytest.mark.parametrize("encoding", ["bgr16", "rgb16", "bgra16", "rgba16"])
def test_16_bit_colour_comes_in_as_bgr8(encoding: str) -> None:
    pixels = random_pixels(encoding, np.random.default_rng(2))
    pixels = np.dstack([pixels, pixels[:, :, 0]]) if "a" in encoding else pixels
    frame = m.read_image(serialize_message(ros_image(pixels, encoding)), m.IMAGE)
    bgr = pixels[:, :, :3] if encoding.startswith("b") else pixels[:, :, 2::-1]
    np.testing.assert_allclose(frame.image, bgr / 257, atol=0.51)


def test_pixels_are_a_view_of_immutable_bytes_and_a_copy_of_others() -> None:
    cdr = serialize_message(ros_image(np.full((4, 6), 9, np.uint8), "mono8"))
    seen = m.read_image(cdr, m.IMAGE).image
    assert np.shares_memory(seen, np.frombuffer(cdr, np.uint8))
    assert not seen.flags.writeable
    reused = bytearray(cdr)
    kept = m.read_image(memoryview(reused), m.IMAGE).image
    reused[-24:] = bytes(24)
    assert (kept == 9).all()


def test_big_endian_cdr_is_read() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    cdr = m.image_cdr(np.arange(12, dtype=np.uint8).reshape(3, 4), "mono8", HEADER)
    swapped = bytes(store.serialize_cdr(store.deserialize_cdr(cdr, m.IMAGE), m.IMAGE, little_endian=False))
    frame = m.read_image(swapped, m.IMAGE)
    assert frame.stamp_ns == m.read_stamp(swapped) == HEADER.stamp_ns
    np.testing.assert_array_equal(frame.image.ravel(), np.arange(12))


# compressed images ----------------------------------------------------------------------------------------------------
def compressed(data: bytes) -> bytes:
    return serialize_message(CompressedImage(format="whatever it says", data=array("B", data)))


def encoded(suffix: str, pixels: np.ndarray) -> bytes:
    return bytes(cv2.imencode(suffix, pixels)[1])


def smooth(channels: int) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, 200, 48), np.linspace(0, 50, 32))
    image = np.stack([x + y, 255 - x, 100 + y, x][:channels], axis=2).astype(np.uint8)
    return image[:, :, 0] if channels == 1 else image


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("depth", [8, 16])
def test_png_comes_in_as_bgr8(channels: int, depth: int) -> None:
    pixels = smooth(channels)
    stored = pixels if depth == 8 else pixels.astype(np.uint16) * 257
    frame = m.read_image(compressed(encoded(".png", stored)), m.COMPRESSED_IMAGE)
    expected = np.dstack([pixels] * 3) if channels == 1 else pixels[:, :, :3]
    assert frame.encoding == "bgr8"
    np.testing.assert_array_equal(frame.image, expected)


@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_comes_in_as_bgr8(channels: int) -> None:
    frame = m.read_image(compressed(encoded(".jpg", smooth(channels))), m.COMPRESSED_IMAGE)
    expected = np.dstack([smooth(1)] * 3) if channels == 1 else smooth(3)
    np.testing.assert_allclose(frame.image, expected, atol=6)


def test_jpeg_is_not_turned_by_its_exif_orientation() -> None:
    jpeg = encoded(".jpg", smooth(3))
    tiff = b"MM\0*\0\0\0\x08" + b"\0\x01" + struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0) + b"\0\0\0\0"
    app1 = b"\xff\xe1" + struct.pack(">H", 8 + len(tiff)) + b"Exif\0\0" + tiff
    frame = m.read_image(compressed(jpeg[:2] + app1 + jpeg[2:]), m.COMPRESSED_IMAGE)
    assert frame.size == (48, 32)


JPEG, PNG = encoded(".jpg", smooth(3)), encoded(".png", smooth(3))


@pytest.mark.parametrize("data", [
    b"", b"\xff\xd8", JPEG[:20], JPEG[: len(JPEG) // 2], JPEG[:-2], PNG[:20], PNG[: len(PNG) // 2],
    b"GIF89a" + bytes(100), encoded(".bmp", smooth(3)), b"\xff" * 1000, b"\xff\xd8" + b"\xff" * 1000,
    PNG[:16] + struct.pack(">II", 100_000, 100_000) + PNG[24:],  # a bomb by its own header
    PNG[:16] + struct.pack(">II", 0, 48) + PNG[24:],
], ids=lambda data: f"{data[:4].hex()}-{len(data)}")
def test_damaged_compressed_images_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        m.read_image(compressed(data), m.COMPRESSED_IMAGE)


# hostile messages -----------------------------------------------------------------------------------------------------
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
    ({"encoding": "32FC1"}, "32FC1"),
    ({"encoding": "mono8\n" * 100}, "encoding"),
    ({"encoding": "bgr8"}, "step 6"),
    ({"encoding": "8UC99999999999"}, "encoding"),
    ({"encoding": "yuyv", "width": 3}, "even"),
])
def test_messages_that_contradict_themselves_are_refused(fields: dict[str, object], says: str) -> None:
    with pytest.raises(MessageError, match=says) as caught:
        m.read_image(changed(**fields), m.IMAGE)
    assert len(str(caught.value).splitlines()) == 1


def test_encoding_that_is_not_utf8_is_refused() -> None:
    cdr = bytearray(changed())
    at = bytes(cdr).index(b"mono8")
    cdr[at : at + 5] = b"\xff\xfe\xfd\xfc\xfb"
    with pytest.raises(MessageError):
        m.read_image(bytes(cdr), m.IMAGE)


def test_stamp_beyond_a_second_is_refused() -> None:
    cdr = bytearray(changed())
    cdr[8:12] = struct.pack("<I", 10**9)
    for read in (lambda data: m.read_image(data, m.IMAGE), m.read_stamp):
        with pytest.raises(MessageError, match="less than a second"):
            read(bytes(cdr))


def test_image_of_another_type_is_refused() -> None:
    with pytest.raises(MessageError, match="not an image"):
        m.read_image(m.diagnostics_cdr(0, "a", "b", 0, "c", {}), m.DIAGNOSTIC_ARRAY)
    with pytest.raises(MessageError):
        m.read_image(changed(), "nobody/msg/Knows")


READERS: dict[str, tuple[bytes, Callable[[bytes], object]]] = {
    "image": (changed(), lambda cdr: m.read_image(cdr, m.IMAGE)),
    "jpeg": (compressed(JPEG), lambda cdr: m.read_image(cdr, m.COMPRESSED_IMAGE)),
    "png": (compressed(PNG), lambda cdr: m.read_image(cdr, m.COMPRESSED_IMAGE)),
}


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(name: str, data: st.DataObject) -> None:
    sound, read = READERS[name]
    assert len(complaint(read, data.draw(damaged(sound))).splitlines()) <= 1


# images out -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("encoding", ["mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8"])
def test_image_is_byte_for_byte_what_ros_and_the_typestore_write(encoding: str) -> None:
    pixels = random_pixels(encoding, np.random.default_rng(3))
    cdr = m.image_cdr(pixels, encoding, HEADER)
    store = get_typestore(Stores.ROS2_JAZZY)
    assert cdr == bytes(store.serialize_cdr(store.deserialize_cdr(cdr, m.IMAGE), m.IMAGE))
    assert deserialize_message(cdr, Image) == ros_image(pixels, encoding)
    assert cdr == m.image_cdr(np.asfortranarray(pixels), encoding, HEADER)
