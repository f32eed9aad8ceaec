"""Definitions of installed message types, found as rosidl installs them and read by other libraries."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stab_ros.io.bag import BagWriter, definition_of, open_bag
from stab_ros.io.installed_types import installed_definition, live_topic, python_folders

GOALS = "nav_msgs/msg/Goals"  # installed, newer than the types that rosbags knows
GAUGE = "river_msgs/msg/Gauge"
RULE = "=" * 80 + "\n"
GAUGE_MSG = """\
# A level, where # is a comment.
uint8 DATUM=1          # constant
string SITE='a # b'
Level level
other_msgs/Bed[<=3] beds
string<=16 name "none"
string[<=3] notes
int32[2] pair [1, 2]
"""
LEVEL_MSG = "other_msgs/Bed bed\nfloat64 level_m 1.5"  # without a line break at the end
BED_MSG = "builtin_interfaces/Time stamp\n"
TIME_MSG = "int32 sec\nuint32 nanosec\n"
Install = Callable[[str, str], Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Writes the file of a type, as in `river_msgs/msg/Gauge.msg`, into a prefix that is sourced."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")

    def write(name: str, text: str) -> Path:
        path = tmp_path / "share" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return write


def hash_of(msgtype: str, text: str) -> str:
    """RIHS01 by rosbags."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, msgtype))
    return store.hash_rihs01(msgtype)


def test_a_definition_beside_its_python_package() -> None:
    found = installed_definition(GOALS)
    assert found is not None
    assert found.encoding == "ros2msg"
    (place,) = python_folders("nav_msgs")
    (listed,) = [path for prefix in place.parents for path in prefix.glob("share/nav_msgs/msg/Goals.json")]
    assert hash_of(GOALS, found.text) == json.loads(listed.read_text())["type_hashes"][0]["hash_string"]


def test_a_definition_along_the_prefix_path(install: Install) -> None:
    for name, text in (("river_msgs/msg/Gauge", GAUGE_MSG), ("river_msgs/msg/Level", LEVEL_MSG),
                       ("other_msgs/msg/Bed", BED_MSG)):
        install(f"{name}.msg", text)
    found = installed_definition(GAUGE)
    assert found is not None
    gauge, *parts = found.text.split(RULE)
    assert gauge == GAUGE_MSG  # constants, defaults and bounds as the file has them
    assert [part.partition("\n")[0] for part in parts] == [
        "MSG: river_msgs/Level", "MSG: other_msgs/Bed", "MSG: builtin_interfaces/Time"]
    known = get_types_from_msg(found.text, GAUGE)
    assert set(known) == {GAUGE, "river_msgs/msg/Level", "other_msgs/msg/Bed", "builtin_interfaces/msg/Time"}


def test_wide_strings_are_no_types(install: Install) -> None:
    install("river_msgs/msg/Wide.msg", "wstring text\nwstring<=8[] texts\n")
    found = installed_definition("river_msgs/msg/Wide")
    assert found is not None
    assert found.text == "wstring text\nwstring<=8[] texts\n"


def test_a_definition_in_idl(install: Install) -> None:
    bed = "module other_msgs { module msg { struct Bed { int32 id; }; }; };\n"
    depth = ('#include "other_msgs/msg/Bed.idl"\n\n'
             "module river_msgs { module msg { struct Depth { other_msgs::msg::Bed bed; }; }; };\n")
    install("river_msgs/msg/Depth.idl", depth)
    install("other_msgs/msg/Bed.idl", bed)
    topic = live_topic("/depth", "river_msgs/msg/Depth", "", "")
    assert topic.schema_encoding == "ros2idl"
    parts = f"{RULE}IDL: river_msgs/msg/Depth\n{depth}{RULE}IDL: other_msgs/msg/Bed\n{bed}"  # as rosbag2 writes them
    assert topic.definition == parts


def test_a_type_that_uses_itself_or_what_is_missing(install: Install) -> None:
    install("river_msgs/msg/Loop.msg", "river_msgs/Loop loop\n")
    install("river_msgs/msg/Torn.msg", "other_msgs/Missing part\n")
    found = installed_definition("river_msgs/msg/Loop")
    assert found is not None
    assert found.text == "river_msgs/Loop loop\n"
    assert installed_definition("river_msgs/msg/Torn") is None
    for nonsense in ("__main__/msg/Torn", "../msg/Torn", "river_msgs/msg/../Torn", "", "Torn"):
        assert installed_definition(nonsense) is None


def test_the_common_types_keep_their_definition_unless_they_differ(install: Install) -> None:
    msgtype = "std_msgs/msg/Float64"
    plain = live_topic("/x", msgtype, "", "")
    assert plain.definition == definition_of(msgtype)
    assert live_topic("/x", msgtype, "", plain.type_hash) == plain
    newer = live_topic("/x", msgtype, "", "RIHS01_" + 64 * "0")
    assert newer.type_hash == "RIHS01_" + 64 * "0"
    assert newer.definition.startswith("#")  # the installed file, with its comments


def test_a_topic_without_a_definition_is_read_by_others(tmp_path: Path) -> None:
    bag, cdr = tmp_path / "bag.mcap", b"\0\1\0\0\7\0\0\0"
    topic = live_topic("/gauge", "nobody_msgs/msg/Gauge", "", "RIHS01_" + 64 * "1")
    assert (topic.definition, topic.schema_encoding) == ("", "")
    with BagWriter(bag) as writer:
        writer.add_topic(topic)
        writer.write("/gauge", 1, 1, cdr)
    with bag.open("rb") as file:
        (schema, channel, message), = make_reader(file).iter_messages()
    assert schema is not None
    assert (schema.name, schema.encoding, schema.data) == ("nobody_msgs/msg/Gauge", "", b"")
    assert channel.metadata["topic_type_hash"] == "RIHS01_" + 64 * "1"
    assert message.data == cdr
    with open_bag(bag) as reader:
        assert [one.data for one in reader.messages()] == [cdr]
