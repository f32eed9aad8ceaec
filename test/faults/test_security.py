"""What comes from others is data: it runs nothing, names no file of this machine, and its names stay on their line."""

from __future__ import annotations

import shutil
import sqlite3
import sys
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from bag_makers import FLIGHT, JAZZY, STRING, read
from conftest import Command
from rclpy.qos import ReliabilityPolicy
from recordings import IMAGE_TOPIC, Entry, entries, write_mcap
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from stab_ros.core.errors import InputError
from stab_ros.nodes.qos import replay_qos
from stab_ros.parameters.file import read_config
from stab_ros.synthetic.flight import Shot

NOTES = [message for message in FLIGHT if message.topic == "/notes"]


# YAML that would be code ----------------------------------------------------------------------------------------------
def tags(marker: Path) -> list[str]:
    """Each would make the file `marker`, if it were obeyed."""
    return [f"!!python/object/apply:os.system ['touch {marker}']",
            f"!!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path ['{marker}']]",
            f"!!python/object/new:os.system ['touch {marker}']",
            "!!python/name:os.system", "!!python/module:antigravity"]


@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("text", ["/**:\n  ros__parameters:\n    method: {}\n", "/**: {}\n", "{}\n"])
def test_parameter_file_runs_nothing(tmp_path: Path, number: int, text: str) -> None:
    marker, path = tmp_path / "marker", tmp_path / "a.yaml"
    path.write_text(text.format(tags(marker)[number]))
    with pytest.raises(InputError) as caught:
        read_config(path)
    assert len(str(caught.value).splitlines()) == 1
    assert "python/" in str(caught.value)
    assert not marker.exists()
    assert "antigravity" not in sys.modules


@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("text", ["{}", "- {}", "- reliability: {}"])
def test_recorded_qos_runs_nothing(tmp_path: Path, number: int, text: str) -> None:
    marker = tmp_path / "marker"
    assert replay_qos(text.format(tags(marker)[number])).reliability == ReliabilityPolicy.RELIABLE
    assert not marker.exists()
    assert "antigravity" not in sys.modules


@pytest.mark.parametrize("number", range(5))
def test_recording_with_such_tags_runs_nothing(tmp_path: Path, number: int) -> None:
    marker = tmp_path / "marker"
    path = folder(tmp_path / "bag", StoragePlugin.SQLITE3)
    metadata = path / "metadata.yaml"
    said = metadata.read_text()
    metadata.write_text(said.replace("storage_identifier: sqlite3", f"storage_identifier: {tags(marker)[number]}"))
    assert metadata.read_text() != said
    found = read(path)
    assert len(found.messages) == len(NOTES)
    assert any("no readable metadata.yaml" in line for line in found.warnings)
    assert not marker.exists()
    assert "antigravity" not in sys.modules


# paths in a recording -------------------------------------------------------------------------------------------------
def folder(path: Path, storage: StoragePlugin) -> Path:
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/notes", STRING, typestore=JAZZY)
        for message in NOTES:
            writer.write(connection, message.log_time_ns, message.data)
    return path


def renamed(path: Path, name: str) -> Path:
    """The folder, whose metadata.yaml now names that file."""
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(next(path.glob("bag.*")).name, f"'{name}'"))
    assert name in metadata.read_text()
    return path


@pytest.mark.parametrize("absolute", [False, True])
@pytest.mark.parametrize("storage", StoragePlugin)
def test_recording_outside_of_its_folder_is_not_read(tmp_path: Path, storage: StoragePlugin, absolute: bool) -> None:
    folder(tmp_path / "bag", storage)
    (own,) = (tmp_path / "bag").glob("bag.*")
    outside = own.rename(tmp_path / f"outside{own.suffix}")
    metadata = tmp_path / "bag" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(own.name, str(outside) if absolute else f"../{outside.name}"))
    with pytest.raises(InputError) as caught:
        read(tmp_path / "bag")
    assert len(str(caught.value).splitlines()) == 1
    (tmp_path / "bag" / outside.name).write_bytes(outside.read_bytes())  # within the folder it is read
    assert len(read(tmp_path / "bag").messages) == len(NOTES)


def test_other_file_of_the_machine_is_named_as_missing(tmp_path: Path) -> None:
    path = renamed(folder(tmp_path / "bag", StoragePlugin.MCAP), "../../../../etc/passwd")
    found = read(path)
    assert len(found.messages) == len(NOTES)
    assert found.warnings == [f"{path / 'passwd'}: is missing, its messages are lost",
                              f"{path}: holds nothing that metadata.yaml lists, all its .mcap files were taken"]


@pytest.mark.parametrize("name", ["..%2foutside.db3", "%2e%2e%2foutside.db3", "outside.db3?vfs=memdb", "a.db3#b"])
def test_name_of_a_database_is_no_address(tmp_path: Path, name: str) -> None:
    """SQLite takes `%2f` in an address for a slash."""
    path = folder(tmp_path / "bag", StoragePlugin.SQLITE3)
    shutil.copy(path / "bag.db3", tmp_path / "outside.db3")
    renamed(path, name)
    (path / "bag.db3").unlink()
    (path / name).write_bytes(b"")
    with pytest.raises(InputError, match=r"missing tables|Unrecognized storage format"):
        read(path)


def test_database_that_would_read_another_one(tmp_path: Path) -> None:
    """A view over a virtual table; only tables are read."""
    database = sqlite3.connect(tmp_path / "a.db3")
    database.executescript("CREATE TABLE topics(id); CREATE VIEW messages AS SELECT 1 AS id;")
    database.close()
    with pytest.raises(InputError, match="missing tables"):
        read(tmp_path / "a.db3")


# names in a recording -------------------------------------------------------------------------------------------------
NAMES = ["../../x", "/../../../x", "/cam\n../../x", "/cam\x1b[2J\x1b]0;x\x07", "/cam/\u2028x", "C:\\x", "/" + "x" * 300]
WORST = "../../x\n/../../x\x1b[2J<script>alert(1)</script>"


def bag_of(folder: Path, flight: list[Shot], name: str) -> Path:
    """Its image topic has that name."""
    folder.mkdir(parents=True)
    return write_mcap(folder / "in.mcap", [
        Entry(name if e.topic == IMAGE_TOPIC else f"{name}/other", e.msgtype, e.log_time_ns, e.message)
        for e in entries(flight[:3])])


def assert_kept_inside(folder: Path, root: Path, names: set[str], results: list[CompletedProcess[str]]) -> None:
    """All went well, every line is ours, and there are these files in `folder` and none beside it."""
    assert [one.returncode for one in results] == [0] * len(results)
    assert all(line.startswith("stab-ros: ") for one in results for line in one.stderr.splitlines() if "x" in line)
    assert {path.name for path in folder.iterdir()} == names
    beside = {path for path in root.rglob("*") if folder not in path.parents}
    assert beside == {folder, *(path for path in folder.parents if root in path.parents)}


@pytest.mark.parametrize("name", NAMES)
def test_topic_name_is_no_path(tmp_path: Path, flight: list[Shot], name: str, command: Command) -> None:
    inner = tmp_path / "a" / "b" / "c"
    bag, broken = bag_of(inner, flight, name), inner / "broken.mcap"
    broken.write_bytes(bag.read_bytes()[:-40])
    results = [command("info", bag), command("convert", bag, inner / "copy.mcap"),
               command("recover", broken, inner / "fixed.mcap")]
    assert_kept_inside(inner, tmp_path, {"in.mcap", "copy.mcap", "broken.mcap", "fixed.mcap"}, results)


def test_topic_name_is_no_path_to_stabilize_and_evaluate(tmp_path: Path, flight: list[Shot], command: Command) -> None:
    inner = tmp_path / "a" / "b" / "c"
    bag = bag_of(inner, flight, WORST)
    results = [command("stabilize", bag, inner / "out.mcap", "--homographies", inner / "H.csv", "-p", "start_s:=0.0"),
               command("evaluate", inner / "out.mcap", "--report", inner / "report", "--json", inner / "m.json")]
    assert_kept_inside(inner, tmp_path, {"in.mcap", "out.mcap", "H.csv", "report", "m.json"}, results)
    assert "<script>alert" not in (inner / "report" / "index.html").read_text()


def test_warnings_of_odd_names_are_one_line(tmp_path: Path) -> None:
    writer = Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        writer.write(writer.add_connection("/no\n\u2028tes\r", STRING, typestore=JAZZY), 1, NOTES[0].data)
    database = sqlite3.connect(tmp_path / "bag" / "bag.db3")
    database.execute("UPDATE messages SET data = x'28b52ffd00'")  # as zstd begins
    database.commit()
    database.close()
    (warning,) = read(tmp_path / "bag").warnings
    assert "a message of /no tes at 1 ns is damaged" in warning
    assert len(warning.splitlines()) == 1
