"""Files in messages: decoded, or refused if damaged or hostile."""

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


def compressed(data: bytes, message_format: str = "whatever it says") -> bytes:
    return serialize_message(CompressedImage(format=message_format, data=array("B", data)))


def encoded(suffix: str, pixels: np.ndarray) -> bytes:
    return bytes(cv2.imencode(suffix, pixels)[1])


def smooth(channels: int) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, 200, 48), np.linspace(0, 50, 32))
    image = np.stack([x + y, 255 - x, 100 + y, x][:channels], axis=2).astype(np.uint8)
    return image[:, :, 0] if channels == 1 else image


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("depth", [8, 16])
def test_png_and_tiff_keep_their_depth(suffix: str, channels: int, depth: int) -> None:
    pixels = smooth(channels)
    stored = pixels if depth == 8 else pixels.astype(np.uint16) * 257
    frame = read_image(compressed(encoded(suffix, stored)), COMPRESSED_IMAGE)
    leaves_as = (f"mono{depth}", f"mono{depth}") if channels == 1 else (f"bgr{depth}", "bgr8")
    assert (frame.encoding, frame.warped_encoding) == leaves_as
    expected = pixels if channels == 1 else pixels[:, :, :3]
    np.testing.assert_array_equal(frame.image, expected if depth == 8 else expected.astype(np.uint16) * 257)


@pytest.mark.parametrize("quality", [101, 90])  # lossless, lossy
@pytest.mark.parametrize("channels", [3, 4])
def test_webp_comes_in_as_bgr8(channels: int, quality: int) -> None:
    webp = bytes(cv2.imencode(".webp", smooth(channels), [cv2.IMWRITE_WEBP_QUALITY, quality])[1])
    frame = read_image(compressed(webp), COMPRESSED_IMAGE)
    assert frame.encoding == "bgr8"
    if channels == 3:
        np.testing.assert_allclose(frame.image, smooth(3), atol=12 if quality == 90 else 0)
    for end in (10, 25, len(webp) // 2, len(webp) - 3):
        with pytest.raises(MessageError):
            read_image(compressed(webp[:end]), COMPRESSED_IMAGE)


QUANT_A, QUANT_B = 100 * 101.0, 1 - 100 * 101 / 30.0  # depthQuantA and B for 30 m, as compressed_depth_image_transport


def test_compressed_depth_of_whole_numbers_comes_in_as_mono16() -> None:
    depth = smooth(1).astype(np.uint16) * 20
    frame = read_image(compressed(bytes(12) + encoded(".png", depth), "16UC1; compressedDepth png"), COMPRESSED_IMAGE)
    assert frame.encoding == frame.warped_encoding == "mono16"
    np.testing.assert_array_equal(frame.image, depth)


def test_compressed_depth_in_metres_comes_in_as_32fc1() -> None:
    depth = (2 + smooth(1) / 20).astype(np.float32)
    inverse = np.round(QUANT_A / depth + QUANT_B).astype(np.uint16)
    inverse[3, 5] = 0  # no data
    data = struct.pack("<iff", 0, QUANT_A, QUANT_B) + encoded(".png", inverse)
    frame = read_image(compressed(data, "32FC1; compressedDepth png"), COMPRESSED_IMAGE)
    assert frame.encoding == frame.warped_encoding == "32FC1"
    assert np.isnan(frame.image[3, 5])
    assert np.isnan(frame.image).sum() == 1
    np.testing.assert_allclose(frame.image, np.where(inverse > 0, depth, np.nan), atol=0.01)


@pytest.mark.parametrize(("data", "message_format", "says"), [
    (bytes(500), "16UC1; compressedDepth rvl", "format to png"),
    (bytes(12) + encoded(".jpg", smooth(1)), "16UC1; compressedDepth png", "grey PNG of 16 bits"),
    (bytes(12) + encoded(".png", smooth(1)), "16UC1; compressedDepth png", "grey PNG of 16 bits"),
    (bytes(12) + encoded(".png", smooth(1).astype(np.uint16)), "32FC1; compressedDepth png", "quantisation"),
    (bytes(4), "32FC1; compressedDepth png", "starts with"),
    (encoded(".bmp", smooth(3)), "bmp", "is a BMP, it must be JPEG, PNG, TIFF or WebP; set .* to jpeg or png"),
    (encoded(".jp2", smooth(3)), "jp2", "is JPEG 2000"),
    (b"\0\0\0\1\x67" + bytes(100), "h264", "is a piece of coded video"),
    (encoded(".tiff", smooth(1).astype(np.float32)), "tiff", "8 or 16 bits in strips"),
])
def test_what_is_not_read_is_named(data: bytes, message_format: str, says: str) -> None:
    with pytest.raises(MessageError, match=says) as caught:
        read_image(compressed(data, message_format), COMPRESSED_IMAGE)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(("channels", "encoding"), [(1, "mono8"), (3, "bgr8")])
def test_jpeg_keeps_its_channels(channels: int, encoding: str) -> None:
    frame = read_image(compressed(encoded(".jpg", smooth(channels))), COMPRESSED_IMAGE)
    assert frame.encoding == frame.warped_encoding == encoding
    np.testing.assert_allclose(frame.image, smooth(channels), atol=6)


def test_jpeg_is_not_turned_by_its_exif_orientation() -> None:
    jpeg = encoded(".jpg", smooth(3))
    tiff = b"MM\0*\0\0\0\x08" + b"\0\x01" + struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0) + b"\0\0\0\0"
    app1 = b"\xff\xe1" + struct.pack(">H", 8 + len(tiff)) + b"Exif\0\0" + tiff
    frame = read_image(compressed(jpeg[:2] + app1 + jpeg[2:]), COMPRESSED_IMAGE)
    assert frame.size == (48, 32)


JPEG, PNG, TIFF, WEBP = (encoded(suffix, smooth(3)) for suffix in (".jpg", ".png", ".tiff", ".webp"))


@pytest.mark.parametrize("data", [
    b"", b"\xff\xd8", JPEG[:20], JPEG[: len(JPEG) // 2], JPEG[:-2], PNG[:20], PNG[: len(PNG) // 2],
    b"GIF89a" + bytes(100), encoded(".bmp", smooth(3)), b"\xff" * 1000, b"\xff\xd8" + b"\xff" * 1000,
    PNG[:16] + struct.pack(">II", 100_000, 100_000) + PNG[24:],  # a bomb by its own header
    PNG[:16] + struct.pack(">II", 0, 48) + PNG[24:], TIFF[:20], TIFF[:-20], TIFF[: len(TIFF) // 2],
    WEBP[:24] + b"\xff\xff\xff" * 2 + WEBP[30:] if WEBP[12:16] == b"VP8X" else WEBP[:26] + b"\xff" * 4 + WEBP[30:],
], ids=lambda data: f"{data[:4].hex()}-{len(data)}")
def test_damaged_compressed_images_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        read_image(compressed(data), COMPRESSED_IMAGE)


@pytest.mark.parametrize("intact", [compressed(file) for file in (JPEG, PNG, TIFF, WEBP)],
                         ids=["jpeg", "png", "tiff", "webp"])
@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(intact: bytes, data: st.DataObject) -> None:
    assert len(complaint(lambda cdr: read_image(cdr, COMPRESSED_IMAGE), data.draw(damaged(intact))).splitlines()) <= 1
