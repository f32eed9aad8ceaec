"""What ament's linters check, by our own rules: they run with `colcon test`, too."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("stab_ros", "config")
XML = [ROOT / "package.xml", *sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.xml"))]


def test_flake8_and_pep257() -> None:
    """By ruff, which has the rules of both: pyproject.toml."""
    pytest.importorskip("ruff", reason="ruff is not installed; make lint runs it")
    checked = subprocess.run([sys.executable, "-m", "ruff", "check", "--no-cache", str(ROOT)], capture_output=True,
                             text=True, check=False)
    assert checked.returncode == 0, checked.stdout


@pytest.mark.parametrize("path", XML, ids=lambda path: path.name)
def test_xml_is_well_formed(path: Path) -> None:
    assert ET.parse(path).getroot().tag


def test_the_license_is_the_one_that_is_named() -> None:
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    named = ET.parse(ROOT / "package.xml").find("license")
    assert named is not None
    assert (named.text, named.get("file")) == ("Apache-2.0", "LICENSE")
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text
