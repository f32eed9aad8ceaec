"""Decoded arrays become frames without losing any of their range."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stab_ros.core.errors import MessageError
from stab_ros.io.decoded_image import decoded_frame


def random(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 120, shape).astype(dtype)


@pytest.mark.parametrize(("shape", "dtype", "encoding"), [
    ((5, 7), np.uint8, "mono8"), ((5, 7, 1), np.uint8, "mono8"), ((5, 7, 2), np.uint8, "mono8"),
    ((5, 7, 3), np.uint8, "bgr8"), ((5, 7, 4), np.uint8, "bgra8"),
    ((5, 7), np.uint16, "mono16"), ((5, 7, 2), np.uint16, "mono16"), ((5, 7, 3), np.uint16, "bgr16"),
    ((5, 7, 4), np.uint16, "bgr16"), ((5, 7), ">u2", "mono16"), ((5, 7), np.float32, "32FC1"),
    ((5, 7), np.float64, "32FC1"), ((5, 7, 1), np.float16, "32FC1"), ((5, 7), np.int16, "32FC1"),
])
def test_the_values_stay(shape: tuple[int, ...], dtype: Any, encoding: str) -> None:
    pixels = random(shape, dtype)
    frame = decoded_frame(pixels, 9, "cam")
    expected = pixels.reshape(5, 7, -1)
    expected = expected[:, :, 0] if shape[2:] in ((), (1,), (2,)) else expected
    expected = expected[:, :, :3] if encoding == "bgr16" else expected
    assert (frame.encoding, frame.stamp_ns, frame.frame_id) == (encoding, 9, "cam")
    np.testing.assert_array_equal(frame.image, expected)
    assert frame.image.flags.c_contiguous
    assert frame.image.dtype.isnative


def test_bits_are_black_and_white() -> None:
    bits = np.eye(5, dtype=bool)
    np.testing.assert_array_equal(decoded_frame(bits, 0).image, bits * 255)


@pytest.mark.parametrize(("shape", "dtype"), [
    ((5, 7), np.uint32), ((5, 7), np.int32), ((5, 7, 3), np.float32), ((5, 7, 5), np.uint8), ((5,), np.uint8),
    ((0, 7), np.uint8), ((2, 5, 7, 3), np.uint8), ((5, 7), np.complex64), ((5, 7, 0), np.uint8),
])
def test_others_are_refused(shape: tuple[int, ...], dtype: Any) -> None:
    with pytest.raises(MessageError, match="8 or 16 bit") as caught:
        decoded_frame(np.zeros(shape, dtype), 0)
    assert len(str(caught.value).splitlines()) == 1
