"""Points that the user names: every clear spelling of them, what methods make of them, and one line for all else."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from truth import SIZE, error_px, flat, frame, picture, projective, similarity

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray
from stab_ros.estimation.models import MODELS, minimal_points
from stab_ros.io.points import read_points, read_tracking_points
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_stabilizer, reconfigure
from stab_ros.tracking.stabilizer import Stabilizer

FOUR: list[list[float]] = [[60, 50], [330, 60.4], [340.2, 240], [70, 230.7]]
FEW: dict[str, Value] = {"min_inliers": 2, "manual_points": json.dumps(FOUR)}
TAKING = [name for name, method in METHODS.items() if method.takes_points]


@pytest.mark.parametrize("text", [
    "name,x,y\nV1,10,20.5\nleft bank,1e2,7\n",
    "\ufeffname,x,y\r\nV1,10,20.5\r\nleft bank,100,7\r\n",
    'y,x,name,note\n20.5,10,V1,"a, b"\n7, 100, left bank,\n',
])
def test_a_table_of_points(tmp_path: Path, text: str) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(text.encode())
    assert read_points(path) == (("V1", 10.0, 20.5), ("left bank", 100.0, 7.0))


@pytest.mark.parametrize(("content", "says"), [
    (b"", "no column name"),
    (b"name,x\nV1,10\n", "no column y"),
    (b"name,x,y\n", "holds no point"),
    (b"name,x,y\nV1,10\n", "line 2"),
    (b"name,x,y\nV1,10,nan\n", "line 2"),
    (b"name,x,y\nV1,10,20\n,10,20\n", "line 3"),
    (b"name,x,y\nV1,10,ten\n", "line 2"),
    (b"name,x,y\nV1,10,20\nV1,30,40\n", "V1 twice"),
    (b"name,x,y\n\xff\xfe,1,2\n", "not a table"),
    (b'name,x,y\n"V1,1,2\n', "not a table"),
])
def test_what_is_no_table_of_points(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says) as refused:
        read_points(path)
    assert str(path) in str(refused.value)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_points(tmp_path / "none.csv")


# --- as parameters of the tracker ------------------------------------------------------------------------------------


def test_points_come_from_a_file_or_from_json(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("name,x,y\n" + "".join(f"P{k},{x},{y}\n" for k, (x, y) in enumerate(FOUR)), encoding="utf-8")
    for values in ({"points_file": str(path)}, {"manual_points": json.dumps(FOUR)}):
        found = read_tracking_points(values)
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, FOUR)
    assert read_tracking_points({}).shape == (0, 2)
    assert read_tracking_points({"points_file": "", "manual_points": " "}).shape == (0, 2)


@pytest.mark.parametrize("text", [
    "[]", "[[]]", "[1, 2]", "[[1, 2, 3]]", "[[1, 2], [3]]", '[["a", 2]]', "[[1, NaN]]", "[[1, Infinity]]", "{}", "x",
    "[[[1, 2]]]", "[[1, 2]", "null", "points.csv", "[[1, null]]", pytest.param("[" * 5000, id="nested too deep"),
])
def test_what_is_no_list_of_points_is_one_line(text: str) -> None:
    with pytest.raises(InputError, match=r"^manual_points: .* must ") as refused:
        read_tracking_points({"manual_points": text})
    assert len(str(refused.value).splitlines()) == 1


def test_two_sources_of_points_are_refused() -> None:
    with pytest.raises(InputError, match="points_file and manual_points are both given"):
        make_stabilizer({"points_file": "p.csv", "manual_points": "[[1, 2]]"})


def used_px(stabilizer: Stabilizer) -> FloatArray:
    assert stabilizer.last_match is not None
    return stabilizer.last_match[0].reference_px


@pytest.mark.parametrize("method", TAKING)
def test_features_are_the_points(method: str) -> None:
    stabilizer = make_stabilizer({**FEW, "method": method, "exclude": "[[[0, 0], [399, 0], [399, 120], [0, 120]]]"})
    start = stabilizer.track(frame(picture()))
    assert (start.matches, start.inliers) == (4, 4)
    assert error_px(stabilizer.track(frame(picture(projective()), 1)), projective()) < 1.0
    found = used_px(stabilizer)
    assert len(found) == 4  # also the two that lie where the method may choose none
    assert np.abs(found - FOUR).max() <= 0.75
    if method == "klt":
        np.testing.assert_allclose(found, FOUR, atol=1e-4)


@pytest.mark.parametrize("method", TAKING)
@pytest.mark.parametrize("model", MODELS)
def test_as_many_points_as_the_model_needs_are_enough(method: str, model: str) -> None:
    points = [[60, 50], [330, 60], [340, 240], [70, 230]][: minimal_points(model)]
    values: dict[str, Value] = {"min_inliers": 1, "manual_points": json.dumps(points), "model": model, "method": method}
    stabilizer = make_stabilizer(values)
    assert stabilizer.track(frame(picture())).tracked
    assert error_px(stabilizer.track(frame(picture(), 1)), similarity(0, 1)) < 0.3


@pytest.mark.parametrize("model", [model for model in MODELS if model != "translation"])
def test_too_few_points_for_the_model(model: str) -> None:
    least = minimal_points(model)
    values: dict[str, Value] = {"min_inliers": 1, "model": model, "manual_points": json.dumps(FOUR[: least - 1])}
    with pytest.raises(InputError, match=rf"^points: {least - 1} points? cannot determine a {model} homography, "
                                         rf"there must be at least {least}$"):
        make_stabilizer(values)


@pytest.mark.parametrize("method", [name for name in METHODS if name not in TAKING])
def test_methods_that_choose_by_themselves_refuse_points(method: str) -> None:
    with pytest.raises(InputError, match=f"points: {method} finds its features itself"):
        make_stabilizer({**FEW, "method": method})


def test_too_few_points_for_the_gate() -> None:
    with pytest.raises(InputError, match=r"4 points can never be the 12 inliers .* set min_inliers to 4 or less"):
        make_stabilizer({"manual_points": json.dumps(FOUR)})


@pytest.mark.parametrize("method", TAKING)
@pytest.mark.parametrize(("point", "says"), [
    ([400, 50], r"points: \(400, 50\) lies outside the reference of 400x300 px"),
    ([-0.5, 50], r"points: \(-0.5, 50\) lies outside"), ([50, 299.6], "outside"),
    ([2, 150], r"points: \(2, 150\) lies too near the border or on too little texture for "),
    ([200, 297], "too near the border"),
])
def test_points_that_cannot_serve_are_named(method: str, point: list[float], says: str) -> None:
    stabilizer = make_stabilizer({**FEW, "method": method, "manual_points": json.dumps([*FOUR, point])})
    with pytest.raises(InputError, match=says) as refused:
        stabilizer.track(frame(picture()))
    assert len(str(refused.value).splitlines()) == 1
    assert stabilizer.reference is None


def test_points_change_at_run_time() -> None:
    stabilizer = make_stabilizer({"min_inliers": 4})
    stabilizer.track(frame(picture()))
    reconfigure(stabilizer, FEW)
    assert stabilizer.track(frame(picture(), 1)).matches == 4
    with pytest.raises(InputError, match="outside the reference"):
        reconfigure(stabilizer, {**FEW, "manual_points": json.dumps([*FOUR, [SIZE[0], 1]])})
    assert stabilizer.track(frame(picture(), 2)).matches == 4
    reconfigure(stabilizer, {})
    assert stabilizer.track(frame(picture(), 3)).matches > 100


@pytest.mark.parametrize("method", TAKING)
def test_with_points_a_flat_picture_is_lost(method: str) -> None:
    stabilizer = make_stabilizer({**FEW, "method": method})
    stabilizer.track(frame(picture()))
    assert not stabilizer.track(frame(flat(), 1)).tracked
