"""Every parameter of every node, as it describes itself over DDS, beside the tables that commands and docs use."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from live_graph import Graph
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.srv import DescribeParameters, ListParameters

from stab_ros.nodes import (
    discharge_node,
    evaluator_node,
    georeference_node,
    pipeline_node,
    tracker_node,
    velocimetry_node,
)
from stab_ros.nodes.bag_player_node import PlayerSettings
from stab_ros.nodes.bag_recorder_node import RecorderSettings
from stab_ros.nodes.params import table_of
from stab_ros.parameters.discharge import DISCHARGE_PARAMETERS
from stab_ros.parameters.node_settings import ManagedSettings
from stab_ros.parameters.table import EVALUATOR_PARAMETERS, GEOREFERENCE_PARAMETERS, PARAMETERS, VELOCITY_PARAMETERS

pytestmark = pytest.mark.thorough  # nodes that start and end for each case

TABLES: Mapping[str, tuple[Mapping[str, Any], frozenset[str]]] = {
    "tracker_node": ({**PARAMETERS, **tracker_node.SETTINGS, **tracker_node.COMPRESSED},
                     tracker_node.CHANGEABLE | {*tracker_node.COMPRESSED}),
    "evaluator_node": ({**EVALUATOR_PARAMETERS, **evaluator_node.SETTINGS}, evaluator_node.CHANGEABLE),
    "georeference_node": ({**GEOREFERENCE_PARAMETERS, **georeference_node.SETTINGS}, georeference_node.CHANGEABLE),
    "velocimetry_node": ({**VELOCITY_PARAMETERS, **velocimetry_node.SETTINGS}, velocimetry_node.CHANGEABLE),
    "discharge_node": ({**DISCHARGE_PARAMETERS, **discharge_node.SETTINGS}, discharge_node.CHANGEABLE),
    "pipeline_node": (pipeline_node.SETTINGS, frozenset()),
    "bag_player_node": (table_of(PlayerSettings), frozenset()),
    "bag_recorder_node": (table_of(RecorderSettings), frozenset()),
}
SECTION = "X,Y,Z\n0,0,10\n5,0,8\n10,0,10\n"
TYPES = {bool: 1, int: 2, float: 3, str: 4}
OF_ROS = {"use_sim_time", "start_type_description_service"}


def needed(node: str, folder: Path, recordings: Mapping[str, Path]) -> dict[str, Any]:
    """What a node does not start without."""
    (folder / "section.csv").write_text(SECTION)
    given: dict[str, dict[str, Any]] = {
        "georeference_node": {"orientation": "dynamic_stabilization", "height_m": 30.0},
        "discharge_node": {"section_file": str(folder / "section.csv"), "wse_m": 9.5},
        "bag_player_node": {"bag": str(recordings["mcap"]), "wait_for_subscribers": 1000},
        "bag_recorder_node": {"output": str(folder / "out.mcap")},
    }
    return given.get(node, {})


def described(graph: Graph, node: str) -> dict[str, ParameterDescriptor]:
    names = graph.call(ListParameters, f"/{node}/list_parameters", ListParameters.Request()).result.names
    request = DescribeParameters.Request(names=names)
    answer = graph.call(DescribeParameters, f"/{node}/describe_parameters", request)
    return {one.name: one for one in answer.descriptors}


@pytest.mark.parametrize("node", TABLES)
def test_every_parameter_describes_itself(
    node: str, graph: Graph, tmp_path: Path, recordings: Mapping[str, Path]
) -> None:
    own, changeable = TABLES[node]
    table = {**own, **({} if node == "pipeline_node" else table_of(ManagedSettings))}
    graph.start(node, **needed(node, tmp_path, recordings))
    shown = described(graph, node)
    assert all(one.description for one in shown.values()), [name for name, one in shown.items() if not one.description]
    others = {name for name in shown if name not in table and not name.startswith("qos_overrides.")}
    assert others == OF_ROS | ({"topics"} if node == "bag_recorder_node" else set())
    assert all(one.read_only for name, one in shown.items() if name.startswith("qos_overrides.") or name == "topics")
    for name, parameter in table.items():
        one, limits = shown[name], parameter.limits
        assert (one.description, one.read_only) == (limits.doc, name not in changeable)
        assert (one.type, one.dynamic_typing) == (TYPES[type(parameter.default)], False)
        if type(parameter.default) in (int, float):
            (bounds,) = one.integer_range or one.floating_point_range
            assert (bounds.from_value, bounds.to_value) == (limits.low, limits.high)
        for choice in limits.choices:
            assert choice in one.additional_constraints


@pytest.mark.parametrize("node", TABLES)
def test_every_number_has_a_range_and_every_parameter_a_meaning(node: str) -> None:
    for name, parameter in TABLES[node][0].items():
        assert parameter.limits.doc, name
        if type(parameter.default) in (int, float):
            assert parameter.limits.low is not None, name
            assert parameter.limits.high is not None, name
            assert parameter.limits.low <= parameter.default <= parameter.limits.high


def test_the_page_of_parameters_is_that_of_the_tables() -> None:
    root = Path(__file__).parents[2]
    written = (root / "docs" / "parameters.md").read_text(encoding="utf-8")
    for table, _ in TABLES.values():
        for name, parameter in table.items():
            assert f"| `{name}` |" in written
            assert parameter.limits.doc in written
