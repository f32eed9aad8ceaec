"""JPEG and PNG in messages: decoded, or refused if damaged or hostile."""

from __future__ import annotations

import struct
from array import array

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import complaint, damaged
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CompressedImage

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import COMPRESSED_IMAGE
from stab_ros.io.image_message import read_image


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
    frame = read_image(compressed(encoded(".png", stored)), COMPRESSED_IMAGE)
    expected = np.dstack([pixels] * 3) if channels == 1 else pixels[:, :, :3]
    assert frame.encoding == "bgr8"
    np.testing.assert_array_equal(frame.image, expected)


@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_comes_in_as_bgr8(channels: int) -> None:
    frame = read_image(compressed(encoded(".jpg", smooth(channels))), COMPRESSED_IMAGE)
    expected = np.dstack([smooth(1)] * 3) if channels == 1 else smooth(3)
    np.testing.assert_allclose(frame.image, expected, atol=6)


def test_jpeg_is_not_turned_by_its_exif_orientation() -> None:
    jpeg = encoded(".jpg", smooth(3))
    tiff = b"MM\0*\0\0\0\x08" + b"\0\x01" + struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0) + b"\0\0\0\0"
    app1 = b"\xff\xe1" + struct.pack(">H", 8 + len(tiff)) + b"Exif\0\0" + tiff
    frame = read_image(compressed(jpeg[:2] + app1 + jpeg[2:]), COMPRESSED_IMAGE)
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
        read_image(compressed(data), COMPRESSED_IMAGE)


@pytest.mark.parametrize("intact", [compressed(JPEG), compressed(PNG)], ids=["jpeg", "png"])
@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(intact: bytes, data: st.DataObject) -> None:
    assert len(complaint(lambda cdr: read_image(cdr, COMPRESSED_IMAGE), data.draw(damaged(intact))).splitlines()) <= 1
