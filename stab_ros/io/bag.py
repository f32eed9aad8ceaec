"""Recordings: read in every supported format, written as MCAP."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import yaml

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.io.bag_types import BagReader, Message, Topic, definition_of, topic_of
from stab_ros.io.bag_writer import BagWriter
from stab_ros.io.ros1_mcap import Ros2McapReader
from stab_ros.io.rosbags_reader import RosbagsReader

__all__ = ["BagReader", "BagWriter", "Message", "Topic", "definition_of", "open_bag", "topic_of"]

_METADATA_LIMIT = 2**20  # characters of metadata.yaml: thousands of files and topics
KINDS = "an .mcap, a rosbag2 folder or a ROS 1 .bag"


@contextmanager
def open_bag(path: Path) -> Iterator[BagReader]:
    """Opens a recording of any supported format; a damaged MCAP gives what is readable, and warnings.

    Raises:
        InputError: missing, none of our kinds, or damaged beyond reading.
    """
    try:
        opened = _reader_of(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}, the recording must be {KINDS}") from error
    with closing(opened) as reader:
        yield reader


def _reader_of(path: Path) -> Ros2McapReader | RosbagsReader:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder, the recording must be {KINDS}")
    if path.is_dir():
        return _folder_reader(path)
    name = path.name.lower()
    if name.endswith((".mcap", ".mcap.partial")):  # the latter is left when writing was interrupted
        return Ros2McapReader([path])
    if name.endswith((".bag", ".db3")):
        if path.stat().st_size == 0:
            raise InputError(f"{path}: is empty, the recording must be {KINDS}")
        return RosbagsReader(path)
    raise InputError(f"{path}: is no recording by its name, it must be {KINDS}")


def _folder_reader(folder: Path) -> Ros2McapReader | RosbagsReader:
    """Uncompressed MCAP files are read by `McapReader`, as they may be damaged; other rosbag2 folders by rosbags."""
    found = sorted(folder.glob("*.mcap"))
    metadata = _metadata_of(folder)
    if metadata.get("compression_mode", "").lower() not in ("", "none") or (metadata and not found):
        return RosbagsReader(folder)
    if not found:
        raise InputError(f"{folder}: holds no readable metadata.yaml and no .mcap file, the recording must be {KINDS}")
    if not metadata:
        return Ros2McapReader(found, [f"{folder}: has no readable metadata.yaml, all its .mcap files were taken"])
    listed = [folder / Path(name).name for name in metadata["relative_file_paths"]]
    missing = [f"{one_line(path)}: is missing, its messages are lost" for path in listed if path not in found]
    return Ros2McapReader([path for path in listed if path in found] or found, missing)


def _metadata_of(folder: Path) -> dict[str, Any]:
    """The content of metadata.yaml; empty if it is missing or damaged (a killed recorder leaves none)."""
    try:
        with (folder / "metadata.yaml").open(encoding="utf-8") as file:
            text = file.read(_METADATA_LIMIT + 1)
        found = {} if len(text) > _METADATA_LIMIT else yaml.safe_load(text)["rosbag2_bagfile_information"]
        valid = all(isinstance(name, str) for name in found["relative_file_paths"])
        return dict(found) if valid and isinstance(found.get("compression_mode", ""), str) else {}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, yaml.YAMLError):
        return {}
