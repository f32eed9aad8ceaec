"""Every encoding of sensor_msgs/Image, as the real ROS 2 (rclpy) serialises it."""

from __future__ import annotations

import numpy as np
import pytest
from message_makers import HEADER, random_pixels, ros_image
from rclpy.serialization import serialize_message

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import IMAGE
from stab_ros.io.encodings import DECODED
from stab_ros.io.image_message import read_image


@pytest.mark.parametrize("padding", [0, 3, 4])  # of 16 bit, whole values
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize(
    "encoding", ["mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8", "8UC1", "8UC3", "8UC4", "16UC1", "32FC1"])
def test_plain_encodings_come_in_as_they_are(encoding: str, big_endian: bool, padding: int) -> None:
    pixels = random_pixels(encoding, np.random.default_rng(1))
    frame = read_image(serialize_message(ros_image(pixels, encoding, padding * pixels.itemsize, big_endian)), IMAGE)
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
    frame = read_image(serialize_message(ros_image(stored, f"bayer_{pattern}{depth}")), IMAGE)
    assert frame.encoding == f"bgr{depth}"
    full = 1 if depth == 8 else 257
    np.testing.assert_array_equal(frame.image, np.broadcast_to([full * v for v in colour.values()], (16, 20, 3)))


@pytest.mark.parametrize(("encoding", "order"), [
    ("yuv422", "uyvy"), ("uyvy", "uyvy"), ("yuv422_yuy2", "yuyv"), ("yuyv", "yuyv")])
def test_yuv422_follows_bt601(encoding: str, order: str) -> None:
    red = {"y": 81, "u": 90, "v": 240}  # ITU-R BT.601, limited range
    row = np.array([red[letter] for letter in order] * 4, np.uint8).reshape(1, 8, 2)
    frame = read_image(serialize_message(ros_image(np.repeat(row, 5, axis=0), encoding)), IMAGE)
    assert frame.encoding == "bgr8"
    np.testing.assert_allclose(frame.image, np.broadcast_to([0, 0, 255], (5, 8, 3)), atol=2)


@pytest.mark.parametrize("encoding", ["bgr16", "rgb16", "bgra16", "rgba16"])
def test_16_bit_colour_comes_in_as_bgr16(encoding: str) -> None:
    pixels = random_pixels(encoding, np.random.default_rng(2))
    pixels = np.dstack([pixels, pixels[:, :, 0]]) if "a" in encoding else pixels
    frame = read_image(serialize_message(ros_image(pixels, encoding)), IMAGE)
    assert (frame.encoding, frame.warped_encoding) == ("bgr16", "bgr8")
    np.testing.assert_array_equal(frame.image, pixels[:, :, :3] if encoding.startswith("b") else pixels[:, :, 2::-1])


@pytest.mark.parametrize(("encoding", "says"), [
    ("mono10", "mono16"), ("mono12", "mono16"), ("mono12p", "mono16"), ("bayer_rggb12", "bayer_rggb16"),
    ("Mono14Packed", "mono16"), ("nv12", "bgr8 or yuv422_yuy2"), ("nv21", "bgr8"), ("yuv420", "bgr8"), ("i420", "bgr8"),
    ("jpeg", "CompressedImage"), ("h264", "CompressedImage"), ("16SC1", "16UC1 or 32FC1"), ("64FC1", "32FC1"),
    ("8UC2", "bgr8, mono16"), ("32FC3", "bgr8"), ("holographic", "one of mono8, mono16"),
])
def test_an_encoding_that_is_not_read_names_what_to_do(encoding: str, says: str) -> None:
    with pytest.raises(MessageError, match=f"'{encoding}' is not read, .*{says}") as caught:
        read_image(serialize_message(ros_image(np.zeros((4, 6), np.uint16), encoding)), IMAGE)
    assert len(str(caught.value).splitlines()) == 1
