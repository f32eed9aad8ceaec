"""The metadata.yaml of a rosbag2 folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

METADATA = "metadata.yaml"
_LIMIT = 2**20  # characters: thousands of files and topics
_ROOT = "rosbag2_bagfile_information"


def is_rosbag2(folder: Path) -> bool:
    """Whether the folder has a metadata.yaml of rosbag2, whole or damaged; other programs write files of this name."""
    try:
        with (folder / METADATA).open("rb") as file:
            return _ROOT.encode() in file.read(_LIMIT)
    except OSError:
        return False


def listed_files(folder: Path) -> list[str]:
    """The names of files in metadata.yaml; none if it is missing or damaged (a killed recorder leaves none)."""
    try:
        with (folder / METADATA).open(encoding="utf-8") as file:
            text = file.read(_LIMIT + 1)
        found: Any = [] if len(text) > _LIMIT else yaml.safe_load(text)[_ROOT]["relative_file_paths"]
        return [Path(name).name for name in found]
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, yaml.YAMLError):
        return []
