"""Which files of a rosbag2 folder are the recording, whatever its metadata.yaml says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from stab_ros.core.text import one_line

COMPRESSED = ".zstd"  # ends the name of a file that is compressed as a whole
PART_SUFFIXES = (".mcap", ".db3", f".mcap{COMPRESSED}", f".db3{COMPRESSED}")
_METADATA_LIMIT = 2**20  # characters of metadata.yaml: thousands of files and topics


def parts_of(folder: Path) -> tuple[list[Path], list[str]]:
    """The files to read, and what is to be said about the others, one line each.

    Raises:
        OSError: the folder cannot be read.
    """
    found = _found(folder)
    names = _listed(folder)
    if not names:
        suffix, parts = _of_one_kind(found)
        return parts, [f"{folder}: has no readable metadata.yaml, all its {suffix} files were taken"]
    listed = [folder / name for name in names]
    parts = [part for path in listed for part in [_present(path)] if part is not None]
    said = [f"{one_line(path)}: is {'no file' if path.exists() else 'missing'}, its messages are lost"
            for path in listed if _present(path) is None]
    if not parts:
        return _of_one_kind(found)[1], said
    return parts, said + [f"{one_line(path)}: is not listed in metadata.yaml, it was left out"
                          for path in found if path not in parts]


def _found(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.name.lower().endswith(PART_SUFFIXES) and path.is_file())


def _of_one_kind(found: list[Path]) -> tuple[str, list[Path]]:
    """A folder may hold the same recording in several formats."""
    for suffix in PART_SUFFIXES:
        chosen = [path for path in found if path.name.lower().endswith(suffix)]
        if chosen:
            return suffix, chosen
    return PART_SUFFIXES[0], []


def _present(path: Path) -> Path | None:
    """The file of this name, or what compressing or unpacking it by hand has made of it."""
    for candidate in (path, path.with_name(path.name + COMPRESSED), path.with_name(path.name.removesuffix(COMPRESSED))):
        if candidate.is_file():
            return candidate
    return None


def _listed(folder: Path) -> list[str]:
    """The names in metadata.yaml; none if it is missing or damaged (a killed recorder leaves none)."""
    try:
        with (folder / "metadata.yaml").open(encoding="utf-8") as file:
            text = file.read(_METADATA_LIMIT + 1)
        found: Any = [] if len(text) > _METADATA_LIMIT else yaml.safe_load(
            text)["rosbag2_bagfile_information"]["relative_file_paths"]
        return [Path(name).name for name in found]
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, yaml.YAMLError):
        return []
