"""Lists that rcl cannot hold: as text on their way to it, everything else as it was; and files for other nodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from stab_ros.core.errors import InputError
from stab_ros.nodes.nested_lists import lists_as_text, with_lists_as_text
from stab_ros.nodes.parameter_files import files_for_others, is_for, parameters_for_others

NUMBERS = st.integers(-10**6, 10**6) | st.floats(-1e6, 1e6)
NESTED = st.lists(st.lists(st.lists(NUMBERS, min_size=2, max_size=2), min_size=1, max_size=4), min_size=1, max_size=3)


@given(value=NESTED, before=NUMBERS, flow=st.sampled_from([True, False, None]))
def test_nested_lists_become_their_json_in_every_style(value: Any, before: float, flow: bool | None) -> None:
    tree = {"/**": {"ros__parameters": {"a": before, "exclude": value, "z": "last"}}}
    told = yaml.safe_load(lists_as_text(yaml.safe_dump(tree, default_flow_style=flow, sort_keys=False)))
    parameters = told["/**"]["ros__parameters"]
    assert json.loads(parameters.pop("exclude")) == value
    assert parameters == {"a": before, "z": "last"}


@pytest.mark.parametrize("text", [
    "", "21", "32,16", "a.json", "[0, 130, 960, 150]", "[0.5, 1.5]", "[/a, /b]", "'[[[0, 1]]]'", '"[[[0, 1]]]"', "[]",
    "[[0, 1", "&a [[0, 1]]\nb: *a", "{a: [1, 2]}",
])
def test_what_rcl_can_hold_or_must_refuse_stays(text: str) -> None:
    assert lists_as_text(text) == text


def test_whole_numbers_beside_others_become_text() -> None:
    assert lists_as_text("[0, 130.5]") == "'[0, 130.5]'"


def test_comments_and_other_keys_of_a_file_stay(tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    new = tmp_path / "new"
    new.mkdir()
    config.write_text("/**:\n  ros__parameters:\n    exclude:  # water\n      - [0, 1]\n      - [2, 3]\n    # ground\n"
                      "    roi: [[[4, 5]]]  # bank\n    start_s: 1e0\n")
    words = ["tracker_node", "--ros-args", "--params-file", str(config), "-p", "lines:=[[0, 1]]"]
    told = with_lists_as_text([*words, "--", "-p", "a:=[[1]]"], lambda: new)
    assert told[4:] == ["-p", "lines:='[[0, 1]]'", "--", "-p", "a:=[[1]]"]
    assert Path(told[3]).read_text() == (
        "/**:\n  ros__parameters:\n    exclude:  # water\n       '[[0, 1], [2, 3]]'\n    # ground\n"
        "    roi: '[[[4, 5]]]'  # bank\n    start_s: 1e0\n")


def test_files_and_words_that_need_nothing_are_passed_on_as_they_are(tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    config.write_text("/**:\n  ros__parameters: {start_s: 1.0}\n")
    words = ["x", "-p", "a:=[[1]]", "--ros-args", "-r", "__ns:=/a", "--params-file", str(config), "--params-file", "no"]
    assert with_lists_as_text(words, _none) == words


def _none() -> Path:
    raise OSError(30, "Read-only file system")


def test_a_file_that_cannot_be_written_anew_is_one_line(tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    config.write_text("/**:\n  ros__parameters: {roi: [[0, 1]]}\n")
    with pytest.raises(InputError, match=r"my.yaml: .* \(Read-only file system\); write them in quotes"):
        with_lists_as_text(["x", "--ros-args", "--params-file", str(config)], _none)


@pytest.mark.parametrize(("pattern", "node", "fits"), [
    ("/**", "/a/b/n", True), ("/**", "/n", True), ("/*", "/n", True), ("/*", "/a/n", False), ("/**/n", "/n", True),
    ("/**/n", "/a/b/n", True), ("/**/n", "/a/m", False), ("/a/*/n", "/a/b/n", True), ("/a/*/n", "/a/n", False),
    ("n", "/n", True), ("/n", "/a/n", False),
])
def test_keys_of_files_match_as_in_rcl(pattern: str, node: str, fits: bool) -> None:
    assert is_for(pattern, node) is fits


def test_a_file_for_another_node_is_told(tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    config.write_text("/**/tracker_node:\n  ros__parameters: {start_s: 1.0}\n")
    words = ["x", "--ros-args", "--params-file", str(config)]
    assert list(files_for_others(words, "/cam/tracker_node")) == []
    (told,) = files_for_others(words, "/cam/stabiliser")
    assert "nothing of it applies, it is for /**/tracker_node, and this node is /cam/stabiliser" in told


def test_words_for_another_node_are_told() -> None:
    words = ["x", "-p", "a:b:=1", "--ros-args", "-p", "tracker_node:method:=klt", "--param", "bag:=/a:=b", "-p",
             "a:=1:2", "--", "-p", "b:c:=1"]
    assert list(parameters_for_others(words, "/pipeline_node", "/tracker_node")) == []
    (told,) = parameters_for_others(words, "/stabiliser")
    assert told == ("-p tracker_node:method:=klt: nothing of it applies, it is for /tracker_node, and this node is "
                    "/stabiliser; leave tracker_node: out, or write stabiliser instead")
    (told,) = parameters_for_others(words, "/cam/tracker_node")  # which rcl does not take it for
    assert told.endswith("/cam/tracker_node; leave tracker_node: out, or name the node in a parameter file")
