"""Recordings: read in every supported format, written as MCAP."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.text import counted
from stab_ros.io.bag_types import BagReader, Message, Topic, definition_of, topic_of
from stab_ros.io.bag_writer import BagWriter
from stab_ros.io.image_names import image_files
from stab_ros.io.mcap_extras import Extra
from stab_ros.io.other_storage import ROS1_SUFFIXES
from stab_ros.io.ros1_mcap import Ros2McapReader
from stab_ros.io.rosbag2_folder import COMPRESSED, parts_of
from stab_ros.io.rosbags_reader import RosbagsReader
from stab_ros.io.split_reader import SplitReader

__all__ = ["BagReader", "BagWriter", "Extra", "Message", "Topic", "definition_of", "open_bag", "topic_of"]

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


def _reader_of(path: Path) -> Ros2McapReader | RosbagsReader | SplitReader:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder, the recording must be {KINDS}")
    if path.is_dir():
        return _folder_reader(path)
    name = path.name.lower()
    if name.endswith((".mcap", ".mcap.partial")):  # the latter is left when writing was interrupted
        return Ros2McapReader([path])
    if name.endswith((*ROS1_SUFFIXES, ".db3")):
        if path.stat().st_size == 0:
            raise InputError(f"{path}: is empty, the recording must be {KINDS}")
        return RosbagsReader(path)
    if name.endswith((f".mcap{COMPRESSED}", f".db3{COMPRESSED}")):
        return SplitReader([path])
    raise InputError(f"{path}: is no recording by its name, it must be {KINDS}")


def _folder_reader(folder: Path) -> Ros2McapReader | SplitReader:
    """MCAP files are read as one, block by block."""
    parts, said = parts_of(folder)
    if not parts:
        why = "; ".join(said) or "it is empty"
        raise InputError(f"{folder}: holds no recording ({why}), the recording must be {KINDS}")
    whole = all(path.name.lower().endswith(".mcap") for path in parts)
    said += _images_beside(folder)
    return Ros2McapReader(parts, said) if whole else SplitReader(parts, said)


def _images_beside(folder: Path) -> list[str]:
    """That a folder with a bag also holds images, which somebody may have meant."""
    images = image_files(folder)
    left_out = counted(len(images), "image in it is", "images in it are")
    return [f"{folder}: is taken as a bag, {left_out} left out"] if images else []
