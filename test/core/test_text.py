"""Counts in words."""

from __future__ import annotations

import pytest

from stab_ros.core.text import are, counted


@pytest.mark.parametrize(("n", "said"), [(0, "0 frames are"), (1, "1 frame is"), (2, "2 frames are")])
def test_one_is_singular_and_all_else_plural(n: int, said: str) -> None:
    assert f"{counted(n, 'frame')} {are(n)}" == counted(n, "frame is", "frames are") == said
