"""The definitions of message types as they are installed: the files from which rosidl made each package.

As rosbag2 does, a definition is the text of the type's own file, with those of the types that it uses behind it.
"""

from __future__ import annotations

import importlib.util
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from stab_ros.io.bag_types import Topic, topic_of
from stab_ros.io.cdr import typestore

_TYPE = re.compile(r"([a-z]\w*)/(?:msg/)?(\w+)", re.ASCII)  # package/msg/Name, package/Name
_RULE = 80 * "="
_PRIMITIVES = frozenset({
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64",
    "uint64", "string", "wstring",
})
_IDL_INCLUDE = re.compile(r"""^\s*#include\s+["<](\w+/msg/\w+)\.idl[">]""", re.MULTILINE)


@dataclass(frozen=True)
class Definition:
    """text: with its dependencies. encoding: ros2msg or ros2idl, as MCAP names them."""

    text: str
    encoding: str


@dataclass(frozen=True)
class _Format:
    """encoding: as MCAP names it. suffix: of the files. heading: of a part, to be filled with package and name.

    first: whether the first part has a heading, too. uses: the types that a text of a package names.
    """

    encoding: str
    suffix: str
    heading: str
    first: bool
    uses: Callable[[str, str], Iterator[str]]


def live_topic(name: str, msgtype: str, qos: str, type_hash: str) -> Topic:
    """A topic as its publishers have it.

    type_hash: theirs, "" if unknown. A type of ROS 2 Jazzy that is theirs has the definition that we always write, any
    other the installed one; without one on disk, definition and schema_encoding are empty.
    """
    if msgtype in typestore().fielddefs:
        known = topic_of(name, msgtype, qos)
        if type_hash in ("", known.type_hash):
            return known
    found = installed_definition(msgtype) or Definition("", "")
    return Topic(name, msgtype, 0, found.text, qos, schema_encoding=found.encoding, type_hash=type_hash)


def installed_definition(msgtype: str) -> Definition | None:
    """The definition of a type such as `px4_msgs/msg/VehicleStatus`.

    It is looked for where the Python package of its messages is installed, then along AMENT_PREFIX_PATH.

    Returns:
        None where the files are not installed, or not all of those that it needs.
    """
    for form in _FORMATS:
        text = _full_text(msgtype, form)
        if text is not None:
            return Definition(text, form.encoding)
    return None


def _full_text(msgtype: str, form: _Format) -> str | None:
    """The file of a type and those of all types that it uses, each once; None: one of them is missing."""
    parts: list[str] = []
    waiting, met = [msgtype], {msgtype}
    while waiting:
        named = _TYPE.fullmatch(waiting.pop(0))
        text = named and _read(named[1], named[2] + form.suffix)
        if named is None or text is None:
            return None
        heading = f"{_RULE}\n{form.heading.format(*named.groups())}\n" if parts or form.first else ""
        parts.append(heading + text)
        for used in map(_normalized, form.uses(text, named[1])):
            if used not in met:
                met.add(used)
                waiting.append(used)
    return "".join(parts)


def _normalized(msgtype: str) -> str:
    return _TYPE.sub(r"\1/msg/\2", msgtype)


def _read(package: str, name: str) -> str | None:
    """The text of a file of a package of messages, which ends with a line break; None: there is none."""
    for folder in _folders(package):
        try:
            text = (folder / "msg" / name).read_text(encoding="utf-8", errors="surrogateescape")
        except OSError:
            continue
        return text if text.endswith("\n") else f"{text}\n"
    return None


def _folders(package: str) -> Iterator[Path]:
    """Where an installed package may have its files, the one that Python imports first.

    rosidl installs modules into PREFIX/lib/python3.x/site-packages and files into PREFIX/share.
    """
    for place in python_folders(package):
        yield place
        yield from (prefix / "share" / package for prefix in place.parents)
    for prefix_path in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(prefix_path) / "share" / package


def python_folders(package: str) -> list[Path]:
    """Where the modules of an installed Python package lie; it is not imported."""
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # a module that was made without a spec, such as __main__
        spec = None
    return [Path(place) for place in spec.submodule_search_locations or ()] if spec else []


def _used_by_msg(text: str, package: str) -> Iterator[str]:
    """The types of the fields; `Name` alone is one of the same package. A line is `type name`, after any comment."""
    for line in text.splitlines():
        words = line.partition("#")[0].split()
        name = re.split(r"\[|<=", words[0])[0] if words else ""
        if name and not name.startswith("@") and name not in _PRIMITIVES:
            yield name if "/" in name else f"{package}/{name}"


def _used_by_idl(text: str, _package: str) -> Iterator[str]:
    yield from _IDL_INCLUDE.findall(text)


_FORMATS = (
    _Format("ros2msg", ".msg", "MSG: {}/{}", False, _used_by_msg),
    _Format("ros2idl", ".idl", "IDL: {}/msg/{}", True, _used_by_idl),
)
