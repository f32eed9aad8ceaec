"""Pictures made in their messages are the messages that the standard serialiser makes."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from truth import picture

from stab_ros.core.geometry import shift
from stab_ros.core.types import State, Track
from stab_ros.io.cdr import IMAGE, Header, header_of
from stab_ros.io.image_message import image_cdr, read_image
from stab_ros.io.new_bytes import new_bytes
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.parameters.engines import make_stabilizer

STORE = get_typestore(Stores.ROS2_JAZZY)
PICTURES: dict[str, tuple[tuple[int, ...], Any]] = {
    "mono8": ((7, 5), np.uint8), "bgr8": ((7, 5, 3), np.uint8), "bgra8": ((3, 4, 4), np.uint8),
    "mono16": ((6, 9), np.uint16),
}


@pytest.mark.parametrize("frame_id", ["", "cam", "a/longer name"])  # each puts the pixels at another place
@pytest.mark.parametrize("encoding", list(PICTURES))
def test_made_in_place_or_copied(encoding: str, frame_id: str) -> None:
    shape, dtype = PICTURES[encoding]
    image = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, shape, dtype)
    header = Header(12_000_000_034, frame_id)
    message = OutgoingImage(encoding, header)
    room = message.allocate(shape, np.dtype(dtype))
    room[...] = image
    cdr = message.cdr(room)
    assert cdr == image_cdr(image, encoding, header) == OutgoingImage(encoding, header).cdr(image)
    read = STORE.deserialize_cdr(cdr, IMAGE)
    assert bytes(STORE.serialize_cdr(read, IMAGE)) == cdr
    np.testing.assert_array_equal(read_image(cdr, IMAGE).image, image)
    assert (room.shape, room.dtype) == (shape, np.dtype(dtype))


def test_the_warp_fills_the_message() -> None:
    stabilizer, message = make_stabilizer({}), OutgoingImage("mono8", Header(1))
    frame = read_image(image_cdr(picture(), "mono8", Header(1)), IMAGE)
    track = Track(State.TRACKED, 0, 1, 1, 0, ref_H_cur=shift(1.5, -2.25))
    made = stabilizer.warp(frame, track, message.allocate)
    assert made is not None
    cdr = message.cdr(made)
    assert cdr is message.cdr(made)
    expected = stabilizer.warp(frame, track)
    np.testing.assert_array_equal(read_image(cdr, IMAGE).image, expected)
    assert header_of(read_image(cdr, IMAGE)) == Header(1)


def test_new_bytes_keep_what_is_written() -> None:
    made = []
    for number in range(50):
        data, view = new_bytes(1000 + number)
        view[:] = number
        made.append(data)
    gc.collect()
    assert all(data == bytes([number]) * (1000 + number) for number, data in enumerate(made))
    assert new_bytes(0)[0] == b""
