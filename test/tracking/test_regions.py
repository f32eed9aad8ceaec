"""`roi` and `exclude`: polygons and masks, where they hold, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from truth import SIZE, frame, picture, translation

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, Image
from stab_ros.io.regions import read_area
from stab_ros.parameters.engines import make_stabilizer

SQUARE = "[[[100, 50], [300, 50], [300, 250], [100, 250]]]"


def square() -> BoolArray:
    """SQUARE as pixels, its outline included."""
    inside = np.zeros(SIZE[::-1], bool)
    inside[50:251, 100:301] = True
    return inside


def written(path: Path, image: Image) -> str:
    assert cv2.imwrite(str(path), image)
    return str(path)


def test_without_regions_all_is_allowed() -> None:
    assert read_area({}).allowed(SIZE).all()
    assert read_area({"roi": "", "exclude": "  "}).allowed(SIZE).all()


def test_polygons_hold_what_lies_within() -> None:
    np.testing.assert_array_equal(read_area({"roi": SQUARE}).allowed(SIZE), square())
    np.testing.assert_array_equal(read_area({"exclude": SQUARE}).allowed(SIZE), ~square())


@pytest.mark.parametrize("text", [
    "[[100, 50], [300, 50], [300, 250], [100, 250]]", "[100, 50, 300, 50, 300, 250, 100, 250]",
    "[[100, 50, 300, 50, 300, 250, 100, 250]]",
])
def test_one_polygon_in_fewer_brackets(text: str) -> None:
    np.testing.assert_array_equal(read_area({"roi": text}).allowed(SIZE), square())


def test_several_polygons_add_up_and_exclude_wins() -> None:
    two = "[[[0, 0], [40, 0], [40, 40], [0, 40]], [[350, 250], [399, 250], [399, 299], [350, 299]]]"
    allowed = read_area({"roi": two, "exclude": "[[[0, 0], [40, 0], [40, 20], [0, 20]]]"}).allowed(SIZE)
    expected = np.zeros(SIZE[::-1], bool)
    expected[21:41, :41] = expected[250:, 350:] = True
    np.testing.assert_array_equal(allowed, expected)


def test_a_polygon_may_reach_beyond_the_picture() -> None:
    allowed = read_area({"roi": "[[[-50, -50], [99, -50], [99, 500], [-50, 500]]]"}).allowed(SIZE)
    assert allowed[:, :100].all()
    assert not allowed[:, 100:].any()


def test_a_json_file_is_as_good_as_its_text(tmp_path: Path) -> None:
    path = tmp_path / "bank.json"
    path.write_text(SQUARE, encoding="utf-8")
    np.testing.assert_array_equal(read_area({"roi": str(path)}).allowed(SIZE), square())


def test_a_json_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "bank.json"
    path.write_text(SQUARE, encoding="utf-8-sig")
    np.testing.assert_array_equal(read_area({"roi": str(path)}).allowed(SIZE), square())


@pytest.mark.parametrize("kind", ["grey", "one", "16 bit", "bgr", "blue alone", "bgra"])
def test_a_mask_is_inside_where_it_is_not_black(tmp_path: Path, kind: str) -> None:
    grey = square().astype(np.uint8) * 255
    black, opaque = np.zeros_like(grey), np.full_like(grey, 255)
    masks: dict[str, Image] = {
        "grey": grey, "one": grey // 255, "16 bit": grey.astype(np.uint16) * 257, "bgr": np.dstack([grey] * 3),
        "blue alone": np.dstack([grey, black, black]), "bgra": np.dstack([grey, grey, grey, opaque]),
    }
    path = written(tmp_path / "mask.png", masks[kind])
    np.testing.assert_array_equal(read_area({"roi": path}).allowed(SIZE), square())


@given(x=st.integers(0, 300), y=st.integers(0, 200), width=st.integers(2, 99), height=st.integers(2, 99))
def test_any_rectangle_is_filled(x: int, y: int, width: int, height: int) -> None:
    corners = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]]
    allowed = read_area({"roi": json.dumps([corners])}).allowed(SIZE)
    assert allowed.sum() == (width + 1) * (height + 1)
    assert allowed[y : y + height + 1, x : x + width + 1].all()


@pytest.mark.parametrize("name", ["roi", "exclude"])
@pytest.mark.parametrize(("text", "complaint"), [
    ("[[[1, 2], [3, 4]", "must be JSON"),
    ("[[[1, 2], [3, 4], [5]]]", "must be JSON"),
    ('[[["a", 2], [3, 4], [5, 6]]]', "must be JSON"),
    ("[]", "holds no polygon"),
    ("[[]]", "at least 3 points"),
    ("[[[1, 2], [30, 4]]]", "at least 3 points"),
    ("[1, 2, 3]", "3 numbers are no pairs"),
    ("[0, 410]", "ROS keeps the last row of nested lists"),
    ("[[1, 2], [3, 4], [5, 6]]", "has no area"),
    ("[[[1, 2, 3], [4, 5, 6], [7, 8, 0]]]", "at least 3 points"),
    ("[[[0, 0], [100, 100], [100, 0], [0, 100]]]", "crosses itself"),
    ("[[[0, 0], [NaN, 100], [100, 0]]]", "finite"),
    ("[[[0, 0], [Infinity, 100], [100, 0]]]", "finite"),
    ("[[[0, 0], [1e9, 100], [100, 0]]]", "finite"),
    ("[[[null, 0], [1, 100], [100, 0]]]", "finite|must be JSON"),
    pytest.param(f"[[[1{'0' * 400}, 0], [1, 100], [100, 0]]]", "finite|must be JSON", id="too long for a float"),
    pytest.param("[" * 100_000, "must be JSON", id="nested too deep"),
    ("nowhere.json", "neither JSON .* nor an existing"),
    ("nowhere.png", "neither JSON .* nor an existing"),
    pytest.param("0, 0, 100, 0, " * 40, "neither JSON .* nor an existing", id="longer than any file name"),
    ("a\0b", "neither JSON .* nor an existing"),
])
def test_bad_text_is_one_line(name: str, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as error:
        read_area({name: text})
    assert str(error.value).startswith(f"{name}: ")
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(("suffix", "content", "complaint"), [
    (".json", b"", "must be JSON"),
    (".json", b"{}", "polygon|must be JSON"),
    (".json", b'{"roi": 3}', "must be JSON"),
    (".json", b"7", "must be JSON"),
    (".json", b'{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], [9, 9]]]}', "must be JSON .* GeoJSON"),
    (".json", bytes(range(256)), "must be JSON"),
    (".png", b"", "cannot be read as a picture"),
    (".png", b"\x89PNG\r\n\x1a\n and no more", "cannot be read as a picture"),
    (".txt", b"some words", "cannot be read as a picture"),
])
def test_bad_files_are_named_in_one_line(tmp_path: Path, suffix: str, content: bytes, complaint: str) -> None:
    path = tmp_path / f"region{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint) as error:
        read_area({"exclude": str(path)})
    assert str(path) in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_what_does_not_fit_the_reference_is_refused(tmp_path: Path) -> None:
    beside = "[[[500, 10], [600, 10], [600, 90]]]"
    everything = "[[[-1, -1], [400, -1], [400, 300], [-1, 300]]]"
    small = written(tmp_path / "small.png", np.full((30, 40), 255, np.uint8))
    black = written(tmp_path / "black.png", np.zeros(SIZE[::-1], np.uint8))
    for values, complaint in (
        ({"roi": beside}, "roi: it lies outside the reference of 400x300"),
        ({"exclude": beside}, "exclude: it lies outside the reference of 400x300"),
        ({"exclude": everything}, "leave no part of the reference"),
        ({"roi": SQUARE, "exclude": SQUARE}, "leave no part of the reference"),
        ({"roi": small}, "roi: the mask is 40x30, it must be 400x300"),
        ({"roi": black}, "leave no part of the reference"),
    ):
        with pytest.raises(InputError, match=complaint) as error:
            make_stabilizer(values).track(frame(picture()))
        assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("method", ["direct", "klt"])
def test_features_lie_only_where_allowed(method: str) -> None:
    for values, expected in (({"roi": SQUARE}, square()), ({"exclude": SQUARE}, ~square())):
        stabilizer = make_stabilizer({"method": method, **values})
        stabilizer.track(frame(picture()))
        stabilizer.track(frame(picture(translation(1, 0)), 1))
        assert stabilizer.last_match is not None
        x, y = np.round(stabilizer.last_match[0].reference_px).astype(int).T
        assert len(x) > 10
        assert expected[y, x].all()


def test_a_mask_and_its_polygon_give_the_same_homography(tmp_path: Path) -> None:
    mask = written(tmp_path / "bank.png", square().astype(np.uint8))
    found = []
    for region in (SQUARE, mask):
        stabilizer = make_stabilizer({"roi": region})
        stabilizer.track(frame(picture()))
        found.append(stabilizer.track(frame(picture(translation(2.3, 1.1)), 1)).ref_H_cur)
    np.testing.assert_array_equal(found[0], found[1])
