"""Reads a saved static map: from a bag that `stabilize` or a recorder has written, or from a PNG."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.settings import Value
from stab_ros.core.types import Gray, Image
from stab_ros.io.bag import open_bag
from stab_ros.io.bag_source import STATIC_MAP
from stab_ros.io.cdr import IMAGE
from stab_ros.io.compressed_image import MAX_DECODED, decode_file
from stab_ros.io.image_message import read_image
from stab_ros.tracking.static_map import StaticMap


def read_static_map(values: Mapping[str, Value]) -> StaticMap | None:
    """Reads the parameter `static_map`.

    Args:
        values: parameters by name; `static_map` is the path of a PNG (white: static ground) or of a bag with a map.

    Returns:
        The map; None where the parameter is empty.

    Raises:
        InputError: the file is missing, is no image, or is a bag without a map.
    """
    text = str(values.get("static_map", "")).strip()
    if not text:
        return None
    path = Path(text)
    try:
        is_bag = path.is_dir() or path.suffix == ".mcap"
    except OSError as error:  # no possible name of a file
        raise InputError(f"static_map: {text[:80]!r} is no file, it must be a PNG or a bag with a map") from error
    return StaticMap.of_picture(_from_bag(path) if is_bag else _from_image(path))


def read_recorded_map(path: Path, topic: str) -> StaticMap | None:
    """Reads the first map of a recording that tells ground from water, as the tracker first knew it.

    Args:
        path: the bag.
        topic: name of the topic with maps.

    Returns:
        The map; None: there is none.
    """
    with open_bag(path) as bag:
        for message in bag.messages([topic]):
            with suppress(MessageError):
                found = map_of_message(message.data)
                if found is not None:
                    return found
    return None


def map_of_message(cdr: bytes | memoryview) -> StaticMap | None:
    """The map in a sensor_msgs/Image; None: it does not tell ground from water.

    Raises:
        MessageError: no mono8 image.
    """
    frame = read_image(cdr, IMAGE)
    if frame.encoding != "mono8":
        raise MessageError(f"a static map must be mono8, not {frame.encoding}")
    found = StaticMap.of_picture(frame.image)
    return found if found.divides else None


def _from_image(path: Path) -> Gray:
    try:
        image = _in_8_bit(decode_file(np.fromfile(path, np.uint8, MAX_DECODED)))
    except (OSError, ValueError) as error:
        raise InputError(f"static_map: {path} cannot be read, it must be a PNG or a bag with a map") from error
    except MessageError as error:
        raise InputError(f"static_map: {path} is no image, it must be a PNG or a bag with a map ({error})") from error
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def _in_8_bit(image: Image) -> Image:
    """A map of 16 bits is white at 65535."""
    return image if image.dtype == np.uint8 else np.asarray(cv2.convertScaleAbs(image, alpha=255.0 / 65535.0))


def _from_bag(path: Path) -> Gray:
    """The last map in the bag."""
    with open_bag(path) as bag:
        topics = [name for name, topic in bag.topics.items() if name.endswith(STATIC_MAP) and topic.msgtype == IMAGE]
        if len(topics) != 1:
            raise InputError(f"static_map: {path} holds {len(topics)} topics .../static_map, it must hold one")
        last = None
        for message in bag.messages(topics):
            last = message
    if last is None:
        raise InputError(f"static_map: {path} holds no map on {topics[0]}, it must hold one")
    frame = read_image(last.data, IMAGE)
    if frame.encoding != "mono8":
        raise InputError(f"static_map: {path} holds a {frame.encoding} image on {topics[0]}, it must be mono8")
    return frame.image
