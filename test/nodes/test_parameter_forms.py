"""Lists of lists, and words that YAML takes for a bool, as parameters: for commands, nodes and launch files.

Of lists, every form that README shows, taken from it.
"""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import Command
from launch_files import ROOT, started
from live_graph import Graph
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters

from stab_ros.io.homographies import read_homographies
from stab_ros.io.regions import read_area

README = (ROOT / "README.md").read_text(encoding="utf-8")
POLYGON = [[0, 130], [960, 150], [960, 420], [0, 410]]
SIZE = (960, 540)
EXPECTED = read_area({"exclude": json.dumps([POLYGON])}).allowed(SIZE)


def words_of(program: str) -> list[str]:
    """What follows after a program in the line of README that gives it a polygon, as a shell passes it on."""
    (line,) = re.findall(rf"^    \S*{program} (.*exclude:=.*)$", README, re.MULTILINE)
    return shlex.split(line)


def yaml_of_readme() -> str:
    (text,) = re.findall(r"```yaml\n(.*?exclude:.*?)```", README, re.DOTALL)
    return str(text)


def shorter_forms() -> list[str]:
    (line,) = re.findall(r"One polygon may also be (.*)", README)
    return re.findall(r"`(.*?)`", line)


def taken(graph: Graph, *arguments: str, name: str = "tracker_node") -> bool:
    """Whether the tracker that is started with these words leaves out the polygon."""
    tracker = graph.run("tracker_node", ["--ros-args", *arguments])
    graph.until(lambda: "ready" in tracker.log or tracker.process.poll() is not None, "the tracker ready")
    assert tracker.process.poll() is None, tracker.log
    known = text_of(graph, name)
    assert tracker.stop() == 0
    return bool((read_area({"exclude": known}).allowed(SIZE) == EXPECTED).all())


def text_of(graph: Graph, name: str = "tracker_node", parameter: str = "exclude") -> str:
    request = GetParameters.Request(names=[parameter])
    return str(graph.call(GetParameters, f"/{name}/get_parameters", request).values[0].string_value)


def test_the_words_of_readme_for_a_node(graph: Graph) -> None:
    words = words_of("tracker_node")
    assert words[0] == "--ros-args"
    assert taken(graph, *words[1:])


@pytest.mark.thorough
@pytest.mark.parametrize("form", shorter_forms())
def test_the_shorter_forms_for_a_node(form: str, graph: Graph) -> None:
    assert taken(graph, "-p", f"exclude:={form}")


def test_the_file_of_readme_for_a_node_by_any_name(graph: Graph, tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    config.write_text(yaml_of_readme())
    assert taken(graph, "-r", "__node:=stabiliser", "--params-file", str(config), name="stabiliser")


def test_the_words_of_readme_for_a_launch_file(graph: Graph) -> None:
    package, file, *given = words_of("ros2 launch")
    assert package == "stab_ros"
    (node,) = started(ROOT / "launch" / file, **dict(one.split(":=") for one in given))
    assert taken(graph, *node.ros_arguments[1:], name="camera/tracker_node")


def test_a_launch_file_leaves_the_regions_of_its_config(tmp_path: Path) -> None:
    (node,) = started(ROOT / "launch" / "tracker.launch.py", config=str(tmp_path / "my.yaml"))
    assert node.parameters == [tmp_path / "my.yaml"]


def test_the_words_and_the_file_of_readme_for_a_command(
    recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    name, _, _, *words = words_of("stab-ros")
    config = tmp_path / "my.yaml"
    config.write_text(yaml_of_readme())
    tables = []
    forms: list[list[str]] = [words, ["--config", str(config)], ["-p", f"exclude:={shorter_forms()[1]}"], []]
    for number, given in enumerate(forms):
        table = tmp_path / f"{number}.csv"
        done = command(name, recordings["mcap"], tmp_path / "out.mcap", "--force", "--no-image", "--limit", 3,
                       "--homographies", table, *given)
        assert done.returncode == 0, done.stderr
        tables.append(table.read_text())
    assert tables[0] == tables[1] == tables[2] != tables[3]
    assert len(read_homographies(tmp_path / "0.csv")) == 3


FLAT = [number for corner in POLYGON for number in corner]


@pytest.mark.thorough
@pytest.mark.parametrize("value", [
    ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=json.dumps([POLYGON])),  # of `ros2 param set`
    ParameterValue(type=ParameterType.PARAMETER_INTEGER_ARRAY, integer_array_value=FLAT),
    ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=[*map(float, FLAT)]),
    ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=[json.dumps(POLYGON)]),
])
def test_lists_that_are_set_at_run_time(value: Any, graph: Graph) -> None:
    graph.start("tracker_node")
    request = SetParameters.Request(parameters=[ParameterMessage(name="exclude", value=value)])
    (result,) = graph.call(SetParameters, "/tracker_node/set_parameters", request).results
    assert result.successful, result.reason
    assert (read_area({"exclude": text_of(graph)}).allowed(SIZE) == EXPECTED).all()


@pytest.mark.thorough
@pytest.mark.parametrize(("node", "name", "value"), [
    ("tracker_node", "manual_points", [[60, 50], [330, 60.5], [340, 240], [70, 230]]),
    ("tracker_node", "klt.passes", [21, 5]), ("tracker_node", "fft.passes", [32, 16]),
    ("tracker_node", "roi", [[[0, 0], [90.5, 0], [90, 90]], [[200, 0], [290, 0], [290, 90]]]),
    ("evaluator_node", "exclude", [POLYGON]), ("velocimetry_node", "lines", [[[0, 0], [10.5, 2]], [[1, 2], [3, -4]]]),
    ("velocimetry_node", "roi", [POLYGON]), ("georeference_node", "extent", [0, 0, 10.5, 20]),
    ("georeference_node", "origin", [46.5, 8, 500]),
])
def test_every_parameter_that_is_a_list_takes_one(
    graph: Graph, tmp_path: Path, node: str, name: str, value: Any
) -> None:
    config = tmp_path / "my.yaml"
    others: dict[str, Any] = {"method": "klt", "min_inliers": 4} if name == "manual_points" else {}
    if node == "georeference_node":
        others = {"orientation": "dynamic_stabilization", "height_m": 30.0}
    config.write_text(yaml.safe_dump({"/**": {"ros__parameters": {name: value, **others}}}))
    process = graph.run(node, ["--ros-args", "--params-file", str(config)])
    graph.until(lambda: "ready" in process.log or process.process.poll() is not None, "the node ready")
    assert process.process.poll() is None, process.log
    shown = graph.call(GetParameters, f"/{node}/get_parameters", GetParameters.Request(names=[name])).values[0]
    assert json.loads(shown.string_value) == value


OFF = "/**:\n  ros__parameters:\n    rolling_shutter: off\n"


def words_that_say_off(folder: Path) -> dict[str, list[str]]:
    """By form: as `-p`, in a file, in a file that a launch file is given, and as ROS's launch passes its own on."""
    config = folder / "my.yaml"
    config.write_text(OFF)
    (node,) = started(ROOT / "launch" / "tracker.launch.py", config=str(config))
    return {"word": ["--ros-args", "-p", "rolling_shutter:=off"],
            "file": ["--ros-args", "--params-file", str(config)], "launch file": node.ros_arguments,
            "launch": ["--ros-args", "-p", "rolling_shutter:=false"]}


@pytest.mark.parametrize("form", ["word", "launch file", *(pytest.param(name, marks=pytest.mark.thorough)
                                                          for name in ("file", "launch"))])
def test_a_plain_off_for_a_node(form: str, graph: Graph, tmp_path: Path) -> None:
    tracker = graph.run("tracker_node", words_that_say_off(tmp_path)[form])
    graph.until(lambda: "ready" in tracker.log or tracker.process.poll() is not None, "the tracker ready")
    assert tracker.process.poll() is None, tracker.log
    name = "camera/tracker_node" if form == "launch file" else "tracker_node"
    assert text_of(graph, name, "rolling_shutter") == "off"
    if form == "word":
        assert set_off(graph)
    assert tracker.stop() == 0


def set_off(graph: Graph) -> bool:
    """Whether it is taken at run time, as `ros2 param set /tracker_node rolling_shutter off` sends it."""
    assert graph.set_parameter("tracker_node", "rolling_shutter", "auto")[0]
    taken, _ = graph.set_parameter("tracker_node", "rolling_shutter", False)
    return taken and text_of(graph, parameter="rolling_shutter") == "off"


def test_a_plain_off_for_a_command(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    config.write_text(OFF)
    for given in (["-p", "rolling_shutter:=off"], ["--config", str(config)]):
        done = command("stabilize", recordings["mcap"], tmp_path / "out.mcap", "--force", "--no-image", "--limit", 3,
                       *given)
        assert done.returncode == 0, done.stderr
    wrong = command("stabilize", recordings["mcap"], tmp_path / "out.mcap", "--force", "-p", "rolling_shutter:=on")
    assert wrong.returncode == 2
    assert "rolling_shutter: True is a bool, it must be one of auto, off" in wrong.stderr
