"""Values, files and polygons that cannot be: refused with the reason, at start and at run time; the old value stays."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import Command
from live_graph import Graph, image_message
from rcl_interfaces.srv import GetParameters
from recordings import entries, write_mcap
from stream import TrackedStream

from stab_ros.synthetic.flight import Shot

# polygons of a picture of 480x270, and what their refusal says
POLYGONS = {
    "[[[10,10],[400,250],[400,10],[10,250]]]": "cross",
    "[[[9000,9000],[9100,9000],[9100,9100]]]": "outside",
    "[[[10,10],[400,10]]]": "3 points",
    "[[[10,10],[10,10],[10,10]]]": "area",
    "[[[10,10],[200,10],[null,200]]]": "number",
    "[[[10,10],[200,10],[NaN,200]]]": "number",
    "[[1,2],3": "JSON",
    "missing.json": "missing.json",
}
YAML: dict[str, tuple[str | bytes, str]] = {
    "no mapping": ("- 1\n- 2\n", "not a ROS parameter file"),
    "bad indentation": ("/**:\n  ros__parameters:\n method: klt\n   x: 1\n", "YAML"),
    "a tab": ("/**:\n\tros__parameters:\n\t\tmethod: klt\n", "YAML"),
    "a Python object": ("/**:\n  ros__parameters:\n    method: !!python/object/apply:os.getcwd []\n", "YAML"),
    "a list": ("/**:\n  ros__parameters:\n    threshold: [1.0, 2.0]\n", "threshold"),
    "not UTF-8": (b"/**:\n  ros__parameters:\n    method: \xff\xfe\n", "YAML"),
    "unknown": ("/**:\n  ros__parameters:\n    thresold: 1.0\n", "threshold"),
    "out of range": ("/**:\n  ros__parameters:\n    threshold: -1.0\n", "threshold"),
    "no number": ("/**:\n  ros__parameters:\n    threshold: .nan\n", "threshold"),
}


@pytest.mark.parametrize("polygon", POLYGONS)
def test_bad_polygons_are_refused_by_the_command(
    flight: list[Shot], command: Command, tmp_path: Path, polygon: str
) -> None:
    bag = write_mcap(tmp_path / "in.mcap", list(entries(flight[:2])))
    for name in ("roi", "exclude"):
        done = command("stabilize", bag, tmp_path / "out.mcap", "-p", f"{name}:={polygon}")
        assert done.returncode == 2, f"{polygon} was taken"
        (line,) = done.stderr.splitlines()
        assert name in line
        assert POLYGONS[polygon] in line
        assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("what", YAML)
def test_bad_parameter_files_are_refused_by_the_command(
    flight: list[Shot], command: Command, tmp_path: Path, what: str
) -> None:
    content, says = YAML[what]
    config = tmp_path / "bad.yaml"
    config.write_bytes(content if isinstance(content, bytes) else content.encode())
    bag = write_mcap(tmp_path / "in.mcap", list(entries(flight[:2])))
    done = command("stabilize", bag, tmp_path / "out.mcap", "--config", config)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert says in line


def test_nothing_bad_is_taken_at_run_time(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph)
    stream.show(image_message(flight[0].image, 1))
    stream.until_answered(1)
    names = ["method", "threshold", "min_inliers", "on_lost", "roi", "exclude", "output_roi", "reference_path"]
    request = GetParameters.Request(names=names)
    before = graph.call(GetParameters, "/tracker_node/get_parameters", request).values
    refused: list[tuple[str, float | str]] = [
        ("method", "magic"), ("threshold", -1.0), ("threshold", float("nan")), ("threshold", float("inf")),
        ("threshold", "wide"), ("min_inliers", 0), ("min_inliers", 1.5), ("on_lost", ""), ("output_roi", "1, 2, 3"),
        ("reference_path", "other.mcap"), *(("roi", polygon) for polygon in POLYGONS),
        *(("exclude", polygon) for polygon in POLYGONS)]
    for name, value in refused:
        taken, reason = graph.set_parameter("/tracker_node", name, value)
        assert not taken, f"{name} {value} was taken"
        assert name in reason or "Wrong parameter type" in reason
        assert len(reason.splitlines()) == 1
    assert graph.call(GetParameters, "/tracker_node/get_parameters", request).values == before
    stream.show(image_message(flight[1].image, 2))
    stream.until_answered(2)
    assert stream.homography(1).any()
    stream.until_told(reset_counter=0, frames_tracked=2)


@pytest.mark.parametrize("what", ["no mapping", "bad indentation", "a Python object", "out of range", "no number"])
def test_bad_parameter_files_end_a_node_at_its_start(graph: Graph, tmp_path: Path, what: str) -> None:
    content, _ = YAML[what]
    config = tmp_path / "bad.yaml"
    assert isinstance(content, str)
    config.write_text(content)
    node = graph.run("tracker_node", ["--ros-args", "--params-file", str(config)])
    assert node.wait() == 2
    (line,) = node.log.splitlines()
    assert line.startswith("tracker_node: ")
    assert any(words in line for words in ("bad.yaml", "threshold", "empty value"))
