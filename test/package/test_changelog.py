"""CHANGELOG.rst is CHANGELOG.md, in the form that the release tools of ROS read."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from pathlib import Path

import docutils.core
import pytest
from catkin_pkg.changelog import BulletList, Changelog, populate_changelog_from_rst
from catkin_pkg.changelog_generator import FORTHCOMING_LABEL

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def rst() -> str:
    return (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")


def test_it_is_made_from_the_markdown(rst: str) -> None:
    make = [sys.executable, str(ROOT / "docs" / "make_changelog.py")]
    assert subprocess.run(make, capture_output=True, text=True, check=True).stdout == rst


def test_docutils_finds_nothing_wrong(rst: str) -> None:
    said = io.StringIO()
    docutils.core.publish_doctree(rst, settings_overrides={"report_level": 1, "warning_stream": said})
    assert said.getvalue() == ""


def test_catkin_reads_every_change_once_the_release_is_tagged(rst: str) -> None:
    """`catkin_tag_changelog` renames the heading of what is not released yet."""
    heading = f"{FORTHCOMING_LABEL}\n{'-' * len(FORTHCOMING_LABEL)}"
    assert rst.count(heading) == 1
    tagged = rst.replace(heading, "9.9.9 (2026-01-31)\n------------------")
    changelog = populate_changelog_from_rst(Changelog("stab_ros"), tagged)
    ((_, _, (content,)),) = [one for one in changelog.foreach_version() if one[0] == "9.9.9"]
    assert isinstance(content, BulletList)
    _, _, after = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").partition("## [Unreleased]")
    markdown = after.partition("\n## [")[0]
    assert len(content.bullets) == len(re.findall(r"^### ", markdown, re.MULTILINE))
    assert len(re.findall(r"^ +\* ", str(content), re.MULTILINE)) == len(re.findall(r"^- ", markdown, re.MULTILINE))
