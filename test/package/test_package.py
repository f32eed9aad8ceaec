"""What the package says about itself agrees with what it is."""

from __future__ import annotations

import inspect
import subprocess
import sys
import xml.etree.ElementTree as ET
from importlib.metadata import entry_points, version
from pathlib import Path

import pytest

import stab_ros

ROOT = Path(__file__).parents[2]


def test_version_is_the_same_everywhere() -> None:
    described = ET.parse(ROOT / "package.xml").findtext("version")
    assert {described, version("stab_ros")} == {stab_ros.__version__}


@pytest.mark.parametrize("name", [
    "stab-ros", "tracker_node", "evaluator_node", "georeference_node", "velocimetry_node", "discharge_node",
    "pipeline_node", "bag_player_node", "bag_recorder_node"])
def test_executable_has_something_to_run(name: str) -> None:
    (script,) = entry_points(group="console_scripts", name=name)
    assert inspect.signature(script.load()).return_annotation == "int"  # its exit code


@pytest.mark.parametrize("page", ["parameters", "inputs"])
def test_pages_of_tables_are_as_the_code_is(page: str) -> None:
    make = [sys.executable, str(ROOT / f"docs/make_{page}.py")]
    made = subprocess.run(make, capture_output=True, text=True, check=True).stdout
    assert (ROOT / f"docs/{page}.md").read_text(encoding="utf-8") == made
