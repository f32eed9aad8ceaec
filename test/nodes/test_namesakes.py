"""Two nodes of one name: told by both while they are there, and by none that takes the place of one that was killed."""

from __future__ import annotations

import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph
from rclpy.executors import SingleThreadedExecutor

from stab_ros.io.diagnostics_message import OK, WARN
from stab_ros.nodes.image_hub import ImageHub

NODE = "/cam/discharge_node"
TOLD = (f"another node is named {NODE} too: services and topics below this name are of both; give one another name, as "
        "-r __node:=NAME, or namespace, as -r __ns:=/NAME")
LEFT = f"no other node is named {NODE} any more"
FEW = 5  # reports: more than it takes to tell


def next_reports(graph: Graph, heard: list[DiagnosticArray]) -> list[tuple[int, str]]:
    """Level and message of a few, after those that were under way."""
    heard.clear()
    graph.until(lambda: len(heard) >= 2 * FEW, "reports")
    return [(ord(one.status[0].level), one.status[0].message) for one in heard[-FEW:]]


def test_two_nodes_of_one_name_say_so_until_one_leaves(graph: Graph) -> None:
    reports: list[DiagnosticArray] = graph.listen(DiagnosticArray, "/diagnostics")
    other = graph.start("discharge_node", "/elsewhere", autostart=False)
    one, two = (graph.start("discharge_node", "/cam", autostart=False) for _ in range(2))
    graph.until(lambda: all(TOLD in node.log for node in (one, two)), "both have said so")
    assert (WARN, f"unconfigured; {TOLD}") in next_reports(graph, reports)
    assert two.stop() == 0
    graph.until(lambda: LEFT in one.log, "that it is alone again")
    assert set(next_reports(graph, reports)) == {(OK, "unconfigured")}
    assert one.log.count("another node") == 1
    assert "another node" not in other.log


@pytest.mark.thorough
def test_a_node_that_was_killed_is_no_namesake_of_the_next_one_and_none_for_ever_of_others(graph: Graph) -> None:
    reports: list[DiagnosticArray] = graph.listen(DiagnosticArray, "/diagnostics")
    one, two = (graph.start("discharge_node", "/cam", autostart=False) for _ in range(2))
    graph.until(lambda: TOLD in one.log and TOLD in two.log, "both have said so")
    for node in (one, two):
        node.process.kill()
        node.wait()
    again = graph.start("discharge_node", "/cam", autostart=False)
    assert set(next_reports(graph, reports)) == {(OK, "unconfigured")}
    assert graph.node.get_node_names().count("discharge_node") == 3, "others still know those that were killed"
    assert "another node" not in again.log
    twin = graph.start("discharge_node", "/cam", autostart=False)
    graph.until(lambda: TOLD in again.log, "it has said so")
    twin.process.send_signal(signal.SIGKILL)
    graph.until(lambda: LEFT in again.log, "that it is alone again")


def test_a_hub_says_so_and_how_to_rename_it_alone(graph: Graph, capfd: pytest.CaptureFixture[str]) -> None:
    hubs = [ImageHub(context=graph.context) for _ in range(2)]
    executor = SingleThreadedExecutor(context=graph.context)
    executor.add_node(hubs[0])
    said = ""

    def is_told() -> bool:
        nonlocal said
        executor.spin_once(timeout_sec=0.1)
        said += capfd.readouterr().err
        return "another node is named /image_hub too" in said

    graph.until(is_told, "the warning")
    assert "-r image_hub:__node:=NAME" in said
    executor.shutdown()
