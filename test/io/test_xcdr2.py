"""Messages in the encodings of DDS: either byte order, CDR and XCDR2; the others are named."""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from stab_ros.core.errors import MessageError
from stab_ros.io.camera_message import read_camera
from stab_ros.io.cdr import COMPRESSED_IMAGE, IMAGE, read_stamp, restamped
from stab_ros.io.diagnostics_message import diagnostics_cdr, read_values
from stab_ros.io.image_message import read_image

JAZZY: Any = get_typestore(Stores.ROS2_JAZZY)
STAMP_NS = 12_000_000_034
PIXELS = np.arange(12, dtype=np.uint16).reshape(3, 4) * 1000
K = np.array([[300.0, 0, 160], [0, 301, 120], [0, 0, 1]])
D = (-0.1, 0.01, 0.0, 0.0, 0.002)


def header(frame_id: str) -> Any:
    return JAZZY.types["std_msgs/msg/Header"](JAZZY.types["builtin_interfaces/msg/Time"](12, 34), frame_id)


def image(frame_id: str) -> Any:
    return JAZZY.types[IMAGE](header(frame_id), 3, 4, "mono16", 0, 8, PIXELS.ravel().view(np.uint8))


def in_xcdr2(cdr: bytes) -> bytes:
    """A message without members of 8 bytes."""
    return bytes((0, cdr[1] + 6)) + cdr[2:]


def camera_info_in_xcdr2(frame_id: str, D: tuple[float, ...], order: str) -> bytes:
    """By the rules, field by field: doubles lie at multiples of 4."""
    def text(value: str) -> bytes:
        data = struct.pack(f"{order}I", len(value) + 1) + value.encode() + b"\0"
        return data + bytes(-len(data) % 4)

    P = np.hstack([K, np.zeros((3, 1))])
    doubles = (*D, *K.ravel(), *np.eye(3).ravel(), *P.ravel())
    return (b"\0\7\0\0" if order == "<" else b"\0\6\0\0") + b"".join((
        struct.pack(f"{order}iI", 12, 34), text(frame_id), struct.pack(f"{order}II", 240, 320), text("plumb_bob"),
        struct.pack(f"{order}I", len(D)), struct.pack(f"{order}{len(doubles)}d", *doubles),
        struct.pack(f"{order}IIIIII?", 0, 0, 0, 0, 0, 0, False)))


@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd"])
@pytest.mark.parametrize("little_endian", [True, False])
def test_images_are_read_in_either_byte_order(frame_id: str, little_endian: bool) -> None:
    cdr = bytes(JAZZY.serialize_cdr(image(frame_id), IMAGE, little_endian=little_endian))
    for data in (cdr, in_xcdr2(cdr)):
        frame = read_image(data, IMAGE)
        assert (frame.stamp_ns, frame.frame_id, frame.encoding) == (STAMP_NS, frame_id, "mono16")
        np.testing.assert_array_equal(frame.image, PIXELS)
        assert read_stamp(data) == STAMP_NS


@pytest.mark.parametrize("little_endian", [True, False])
def test_messages_get_another_stamp_in_their_own_byte_order(little_endian: bool) -> None:
    cdr = bytes(JAZZY.serialize_cdr(image("cam"), IMAGE, little_endian=little_endian))
    for data in (cdr, in_xcdr2(cdr)):
        other = restamped(data, 7 * 10**9 + 5)
        assert read_stamp(other) == 7 * 10**9 + 5
        np.testing.assert_array_equal(read_image(other, IMAGE).image, PIXELS)


def test_compressed_images_are_read_in_xcdr2() -> None:
    picture = cv2.imencode(".png", np.zeros((6, 4, 3), np.uint8))[1].ravel()
    message = JAZZY.types[COMPRESSED_IMAGE](header("cam"), "png", picture)
    frame = read_image(in_xcdr2(bytes(JAZZY.serialize_cdr(message, COMPRESSED_IMAGE))), COMPRESSED_IMAGE)
    assert (frame.size, frame.stamp_ns) == ((4, 6), STAMP_NS)


@pytest.mark.parametrize("frame_id", ["", "abc", "abcd", "abcdefgh"])  # the doubles lie at 4 or 8
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("D", [D, ()], ids=len)
def test_cameras_are_read_in_xcdr2(frame_id: str, order: str, D: tuple[float, ...]) -> None:
    camera = read_camera(camera_info_in_xcdr2(frame_id, D, order))
    assert camera.size == (320, 240)
    np.testing.assert_array_equal(camera.K, K)
    np.testing.assert_array_equal(np.ravel(camera.D)[: len(D)], D)


@pytest.mark.parametrize(("kind", "name"), [
    (2, "PL_CDR"), (3, "PL_CDR"), (8, "D_CDR2"), (9, "D_CDR2"), (10, "PL_CDR2"), (11, "PL_CDR2"), (4, "unknown")])
def test_what_ros_does_not_write_is_named(kind: int, name: str) -> None:
    data = bytes((0, kind)) + bytes(JAZZY.serialize_cdr(image("cam"), IMAGE))[2:]
    for read in (lambda: read_image(data, IMAGE), lambda: read_stamp(data)):
        with pytest.raises(MessageError, match=f"serialisation is {name}, it must be CDR or XCDR2"):
            read()


def test_xcdr2_that_is_cut_short_or_holds_structures() -> None:
    whole = in_xcdr2(bytes(JAZZY.serialize_cdr(image("cam"), IMAGE)))
    for length in range(len(whole)):
        with pytest.raises(MessageError):
            read_image(whole[:length], IMAGE)
    with pytest.raises(MessageError, match="several structures"):
        read_values(in_xcdr2(diagnostics_cdr(STAMP_NS, "a", "b", 0, "c", {"key": "value"})))
