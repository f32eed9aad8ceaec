"""The reference of a live stream, saved in a bag so that a restarted tracker resumes from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.errors import InputError, MessageError, WorkError
from stab_ros.core.types import Frame, State, Track
from stab_ros.io.bag import BagWriter, open_bag, topic_of
from stab_ros.io.cdr import CAMERA_INFO, DIAGNOSTIC_ARRAY, IMAGE, header_of
from stab_ros.io.diagnostics_message import read_values
from stab_ros.io.image_message import image_cdr, read_image, static_map_cdr
from stab_ros.io.topics import CAMERA_INFO_TOPIC, REFERENCE_IMAGE_TOPIC, STATIC_MAP_TOPIC, TRACK_TOPIC, topic_in
from stab_ros.io.track_message import track_cdr
from stab_ros.tracking.static_map import StaticMap

_REFERENCE_IMAGE, _STATIC_MAP, _TRACK, _CAMERA_INFO = (
    topic_in("", topic) for topic in (REFERENCE_IMAGE_TOPIC, STATIC_MAP_TOPIC, TRACK_TOPIC, CAMERA_INFO_TOPIC))
_TYPES = {_REFERENCE_IMAGE: IMAGE, _STATIC_MAP: IMAGE, _TRACK: DIAGNOSTIC_ARRAY, _CAMERA_INFO: CAMERA_INFO}
_NEEDED = frozenset(_TYPES) - {_CAMERA_INFO}


@dataclass(frozen=True, eq=False)
class SavedReference:
    """frame: as received, with lens distortion. camera_info: the CameraInfo (CDR) of that, if the tracker uses it.

    reset_counter: the number of references before it.
    """

    frame: Frame
    static_map: StaticMap
    reset_counter: int
    camera_info: bytes | None = None


def save_reference(path: Path, saved: SavedReference) -> None:
    """Replaces `path` in one step: a crash leaves the old file or the new one, an error only the old one.

    Raises:
        InputError: it cannot be written there. WorkError: the disk is full.
    """
    header, stamp_ns = header_of(saved.frame), saved.frame.stamp_ns
    place = Track(State.TRACKED, 0, stamp_ns, stamp_ns, saved.reset_counter)
    messages = {
        _REFERENCE_IMAGE: image_cdr(saved.frame.image, saved.frame.encoding, header),
        _STATIC_MAP: static_map_cdr(saved.static_map, header),
        _TRACK: track_cdr(place, header),
    }
    if saved.camera_info is not None:
        messages[_CAMERA_INFO] = saved.camera_info
    writer = BagWriter(path, overwrite=True)
    try:
        with writer:
            for name, data in messages.items():
                writer.add_topic(topic_of(name, _TYPES[name]))
                writer.write(name, max(stamp_ns, 0), max(stamp_ns, 0), data)
    except WorkError as error:
        writer.partial.unlink(missing_ok=True)  # other recordings keep what there is
        why = error.__cause__.strerror if isinstance(error.__cause__, OSError) else str(error)
        raise WorkError(f"{path}: {why}; nothing has changed there") from error


def load_reference(path: Path) -> SavedReference | None:
    """The reference that `save_reference` wrote; None: there is no such file yet.

    Raises:
        InputError: the file holds something else, or is damaged.
    """
    if not path.exists():
        return None
    with open_bag(path) as bag:
        found = {message.topic: message.data for message in bag.messages(_TYPES)}
        types = {name: topic.msgtype for name, topic in bag.topics.items()}
        damage = "; ".join(bag.warnings)
    if damage or not found.keys() >= _NEEDED or any(types[name] != _TYPES[name] for name in found):
        raise _unusable(path, damage or "it lacks a topic")
    try:
        return SavedReference(read_image(found[_REFERENCE_IMAGE], IMAGE),
                              StaticMap.of_picture(read_image(found[_STATIC_MAP], IMAGE).image),
                              int(read_values(found[_TRACK])["reset_counter"]), found.get(_CAMERA_INFO))
    except (MessageError, LookupError, ValueError) as error:
        raise _unusable(path, str(error)) from error


def _unusable(path: Path, why: str) -> InputError:
    return InputError(f"reference_path: {path} holds no reference that a tracker has saved ({why}), "
                      "it must be such a file or one that does not exist yet")
