"""docs/ros.md names tests as proofs: they exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_test_that_is_named_exists() -> None:
    named = {*re.findall(r"`(test_\w+)`", (ROOT / "docs" / "ros.md").read_text(encoding="utf-8"))}
    texts = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "test").rglob("test_*.py"))
    assert named
    assert named <= {*re.findall(r"^def (test_\w+)", texts, re.MULTILINE)}
