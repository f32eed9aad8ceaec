"""Which files of a rosbag2 folder are the recording, whatever its metadata.yaml says of them."""

from __future__ import annotations

from pathlib import Path

from stab_ros.core.text import one_line
from stab_ros.io.bag_metadata import listed_files

COMPRESSED = ".zstd"  # ends the name of a file that is compressed as a whole
PART_SUFFIXES = (".mcap", ".db3", f".mcap{COMPRESSED}", f".db3{COMPRESSED}")


def parts_of(folder: Path) -> tuple[list[Path], list[str]]:
    """The files to read, and what is to be said about the others, one line each.

    Raises:
        OSError: the folder cannot be read.
    """
    found = _found(folder)
    suffix, chosen = _of_one_kind(found)
    listed = {name: _present(folder, name) for name in listed_files(folder)}
    if not listed:
        return chosen, [f"{folder}: has no readable metadata.yaml, all its {suffix} files were taken"]
    parts = [part for part in dict.fromkeys(listed.values()) if part is not None]
    lost = [folder / name for name, part in listed.items() if part is None]
    said = [f"{one_line(path)}: is {'no file' if path.exists() else 'missing'}, its messages are lost" for path in lost]
    if not parts:
        return chosen, [*said, f"{folder}: holds nothing that metadata.yaml lists, all its {suffix} files were taken"]
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


def _present(folder: Path, name: str) -> Path | None:
    """The file of this name, or what compressing or unpacking it by hand has made of it."""
    candidates = (folder / candidate for candidate in (name, name + COMPRESSED, name.removesuffix(COMPRESSED)))
    return next((path for path in candidates if path.is_file()), None)
