"""Copies of the picture before: counted exactly, said once, in videos, folders and bags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from stab_ros.core.types import Image
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import IMAGE, Header
from stab_ros.io.image_message import image_cdr
from stab_ros.io.repeated_pictures import RepeatedPictures
from stab_ros.io.source import open_source

TOPIC = "/camera/image_raw"


def pictures(numbers: Sequence[int]) -> list[Image]:
    return [np.random.default_rng(number).integers(0, 255, (70, 90), np.uint8) for number in numbers]


def telecine(frames: int) -> list[int]:
    """20 pictures a second in 25 frames a second."""
    return [4 * frame // 5 for frame in range(frames)]


def test_copies_are_counted() -> None:
    seen = RepeatedPictures()
    for image in pictures(telecine(50)):
        seen.add(image)
    assert (seen.pictures, seen.copies) == (50, 10)
    assert "10 of 50 images (20%) are exact copies" in seen.remark()


@pytest.mark.parametrize("change", ["one pixel", "size", "depth"])
def test_what_differs_anywhere_is_no_copy(change: str) -> None:
    (image,) = pictures([1])
    other = {"one pixel": image.copy(), "size": image[:, :-1], "depth": image.astype(np.uint16) + 256}[change]
    if change == "one pixel":
        other[69, 89] ^= 1
    seen = RepeatedPictures()
    for one in (image, other, image, other):
        seen.add(one)
    assert seen.copies == 0
    assert seen.remark() == ""


def test_flat_pictures_are_no_copies() -> None:
    seen = RepeatedPictures()
    for _ in range(5):
        seen.add(np.full((70, 90, 3), (10, 20, 30), np.uint8))
    assert seen.copies == 0


def test_two_copies_among_hundreds_are_not_spoken_of() -> None:
    seen = RepeatedPictures()
    for image in pictures([*range(300), 299, 299]):
        seen.add(image)
    assert seen.copies == 2
    assert seen.remark() == ""


def test_a_folder_says_it_once_and_only_of_what_was_read(tmp_path: Path) -> None:
    for number, image in enumerate(pictures(telecine(25))):
        cv2.imwrite(str(tmp_path / f"{number:03}.png"), image)
    for limit, told in ((None, "5 of 25 images"), (12, "3 of 12 images"), (4, "")):
        with open_source(tmp_path) as source:
            assert len(list(source.frames(limit))) == (limit or 25)
            said = [one for one in source.warnings if "copies" in one]
        assert [told in one for one in said] == [True] * bool(told)


def test_a_bag_says_it_too(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as bag:
        bag.add_topic(topic_of(TOPIC, IMAGE))
        for number, image in enumerate(pictures(telecine(25))):
            stamp_ns = (number + 1) * 40_000_000
            bag.write(TOPIC, stamp_ns, stamp_ns, image_cdr(image, "mono8", Header(stamp_ns, "camera")))
    with open_source(tmp_path / "a.mcap") as source:
        assert len(list(source.frames())) == 25
        assert [one for one in source.warnings if f"{TOPIC}: 5 of 25 images (20%)" in one]
