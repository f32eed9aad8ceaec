"""The lines of stiv."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.io.lines import read_lines

TEXT = "[[[0, 0], [10.5, 2]], [[1, 2], [3, -4]]]"


def test_text_and_file_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "lines.json").write_text(TEXT)
    for value in (TEXT, str(tmp_path / "lines.json")):
        np.testing.assert_array_equal(read_lines({"lines": value}), [[[0, 0], [10.5, 2]], [[1, 2], [3, -4]]])
    assert read_lines({}) == ()


@pytest.mark.parametrize(("text", "count"), [
    ("[0, 1, 2, 3]", 1), ("[[0, 1], [2, 3]]", 1), ("[0, 1, 2, 3, 4, 5, 6, 7]", 2),
])
def test_lines_in_fewer_brackets(text: str, count: int) -> None:
    lines = read_lines({"lines": text})
    assert np.ravel(lines).tolist() == list(range(4 * count))
    assert len(lines) == count


@pytest.mark.parametrize("text", [
    "[]", "[[0, 0], [1, 1], [2, 2]]", "[0, 1, 2]", "[[[0, 0], [0, 0]]]", "[[[0, 0], [1, NaN]]]", '[[["a", 0], [1, 1]]]',
    "[[[0, 0]", "none.json",
])
def test_what_is_no_line_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="lines: "):
        read_lines({"lines": text})
