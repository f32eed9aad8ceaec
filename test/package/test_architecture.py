"""ARCHITECTURE.md is true: what it names exists."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "ARCHITECTURE.md").read_text()


def test_every_module_that_is_named_exists() -> None:
    modules = {path.relative_to(ROOT / "stab_ros").as_posix() for path in (ROOT / "stab_ros").rglob("*.py")}
    named = set(re.findall(r"`([a-z0-9_/]+\.py)`", TEXT))
    assert len(named) > 40
    assert not {name for name in named if not any(f"/{module}".endswith(f"/{name}") for module in modules)}


def test_every_package_is_described() -> None:
    packages = {path.parent.name for path in (ROOT / "stab_ros").glob("*/__init__.py")}
    assert set(re.findall(r"^- `([a-z]+)/`: ", TEXT, re.MULTILINE)) == packages


def test_every_link_leads_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)", TEXT)
    assert links
    assert not [link for link in links if not (ROOT / link).exists()]
