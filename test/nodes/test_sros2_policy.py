"""The SROS2 policy that is shipped allows what the nodes do, asked of the graph of running ones, without security."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from launch_files import ROOT
from live_graph import Graph
from test_discharge_node import section_file

NAMESPACE = "/camera"
NODES = ["tracker_node", "evaluator_node", "georeference_node", "velocimetry_node", "discharge_node",
         "bag_recorder_node"]
KINDS = {("topics", "publish"): "get_publisher_names_and_types_by_node",
         ("topics", "subscribe"): "get_subscriber_names_and_types_by_node",
         ("services", "reply"): "get_service_names_and_types_by_node"}


def allowed(node: str, kind: tuple[str, str]) -> set[str]:
    """Full names. kind: of expression, and what is allowed of it."""
    tree = ElementTree.parse(ROOT / "config" / "sros2" / "policy.xml")
    (profile,) = tree.findall(f".//enclave[@path='{NAMESPACE}/{node}']/profiles/profile[@node='{node}']")
    names = [str(one.text) for part in profile.findall(kind[0]) if part.get(kind[1]) == "ALLOW" for one in part]
    return {name if name.startswith("/") else f"{NAMESPACE}/{name.replace('~', node, 1)}" for name in names}


def parameters_of(node: str, folder: Path) -> dict[str, Any]:
    """That make it do as much as it can."""
    given: dict[str, dict[str, Any]] = {
        "tracker_node": {"use_camera_info": True},
        "georeference_node": {"orientation": "dynamic_gps_imu", "publish_tf": True},
        "discharge_node": {"section_file": section_file(folder)},
        "bag_recorder_node": {"topics": ["/camera/image_raw"], "output": str(folder / "recorded.mcap")},
    }
    return given.get(node, {})


@pytest.mark.thorough
@pytest.mark.parametrize("node", NODES)
def test_every_node_is_allowed_what_it_does(graph: Graph, node: str, tmp_path: Path) -> None:
    process = graph.start(node, NAMESPACE, **parameters_of(node, tmp_path))
    graph.until(lambda: "ready" in process.log or "recording to" in process.log, "the node")
    graph.until(lambda: node in graph.node.get_node_names(), "its name")

    def does(kind: tuple[str, str]) -> set[str]:
        return {name for name, _ in getattr(graph.node, KINDS[kind])(node, NAMESPACE)}

    graph.until(lambda: f"{NAMESPACE}/{node}/set_logger_levels" in does(("services", "reply"))
                and "/diagnostics" in does(("topics", "publish")), "what it does")
    for kind in KINDS:
        assert does(kind) <= allowed(node, kind), kind
