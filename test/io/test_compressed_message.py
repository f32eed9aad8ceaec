"""Compressed images, read as compressed_image_transport's subscriber reads them, and as we do."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CompressedImage

from stab_ros.core.types import Image
from stab_ros.io.cdr import COMPRESSED_IMAGE, Header
from stab_ros.io.compressed_message import Codec, compressed_cdr
from stab_ros.io.image_message import read_image

CHANNELS = {"mono8": 1, "mono16": 1, "32FC1": 1, "bgr8": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}
HEADER = Header(12_000_000_034, "cam")
PNG = Codec("png")
# `format` as compressed_publisher.cpp of Jazzy composes it
FORMATS = {
    ("mono8", "jpeg"): "mono8; jpeg compressed mono8", ("mono8", "png"): "mono8; png compressed ",
    ("bgr8", "jpeg"): "bgr8; jpeg compressed bgr8", ("bgr8", "png"): "bgr8; png compressed bgr8",
    ("rgb8", "jpeg"): "rgb8; jpeg compressed bgr8", ("rgba8", "png"): "rgba8; png compressed bgr8",
    ("mono16", "jpeg"): "mono16; png compressed ", ("mono16", "png"): "mono16; png compressed ",
    ("32FC1", "jpeg"): "32FC1; tiff compressed ", ("bgra8", "jpeg"): "bgra8; jpeg compressed bgr8",
}


def smooth(encoding: str) -> Image:
    x, y = np.meshgrid(np.linspace(0, 200, 96), np.linspace(0, 50, 64))
    image = np.stack([x + y, 255 - x, 100 + y, np.full_like(x, 255)][: CHANNELS[encoding]], axis=2)
    if encoding == "32FC1":
        return (image[:, :, 0] / 7).astype(np.float32)
    if encoding == "mono16":
        return (image[:, :, 0] * 257).astype(np.uint16)
    return image.astype(np.uint8)[:, :, 0] if encoding == "mono8" else image.astype(np.uint8)


def by_image_transport(message: CompressedImage) -> tuple[str, Image]:
    """compressed_subscriber.cpp: the encoding before the semicolon, and channels in its order."""
    image = np.asarray(cv2.imdecode(np.frombuffer(bytes(message.data), np.uint8), cv2.IMREAD_UNCHANGED))
    encoding = message.format.partition(";")[0]
    back = {"rgb8": cv2.COLOR_BGR2RGB, "rgba8": cv2.COLOR_BGR2RGBA, "bgra8": cv2.COLOR_BGR2BGRA}
    if encoding in back:
        assert "compressed bgr" in message.format
        image = np.asarray(cv2.cvtColor(image, back[encoding]))
    return encoding, image


@pytest.mark.parametrize(("encoding", "codec"), list(FORMATS))
def test_image_transport_restores_the_image(encoding: str, codec: str) -> None:
    sent = smooth(encoding)
    message = deserialize_message(compressed_cdr(sent, encoding, HEADER, Codec(codec)), CompressedImage)
    assert message.format == FORMATS[encoding, codec]
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (12, 34, "cam")
    restored_encoding, restored = by_image_transport(message)
    assert restored_encoding == encoding
    assert (restored.shape, restored.dtype) == (sent.shape, sent.dtype)
    lossless = "jpeg" not in message.format
    np.testing.assert_allclose(restored.astype(float), sent.astype(float), atol=0 if lossless else 8)


@pytest.mark.parametrize("encoding", ["mono8", "mono16", "bgr8"])
def test_we_read_it_too(encoding: str) -> None:
    sent = smooth(encoding)
    frame = read_image(compressed_cdr(sent, encoding, HEADER, PNG), COMPRESSED_IMAGE)
    assert (frame.encoding, frame.stamp_ns, frame.frame_id) == (encoding, HEADER.stamp_ns, HEADER.frame_id)
    np.testing.assert_array_equal(frame.image, sent)


def test_quality_and_level_count() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (64, 96), np.uint8)
    sizes = [len(compressed_cdr(noise, "mono8", HEADER, Codec(jpeg_quality=quality))) for quality in (10, 50, 95)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[-1] / 2
    ramp = smooth("mono8")
    levels = [len(compressed_cdr(ramp, "mono8", HEADER, Codec("png", png_level=level))) for level in (0, 9)]
    assert levels[1] < levels[0] / 2
