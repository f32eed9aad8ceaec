"""What /diagnostics tell of a node that takes nothing: what a pause does not mend, and no fault of the stream."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message
from sensor_msgs.msg import Image
from test_discharge_node import section_file
from test_lifecycle import ACTIVATE, CONFIGURE, DEACTIVATE, change, reported

from stab_ros.io.diagnostics_message import WARN
from stab_ros.synthetic.flight import Shot


def first_inactive(graph: Graph, reports: list[DiagnosticArray]) -> tuple[int, str, str]:
    """Level, message and state."""
    graph.until(lambda: reported(reports, "inactive"), "a report of an inactive node")
    return reported(reports, "inactive")[0]


def active(graph: Graph, node: str, topic: str, **parameters: Any) -> Any:
    """Brings a node up; returns a publisher of its images."""
    graph.start(node, autostart=False, **parameters)
    assert change(graph, node, CONFIGURE)
    assert change(graph, node, ACTIVATE)
    return graph.speak(Image, topic)


def test_a_tracker_that_could_not_save_its_reference(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    """As a pause ends the start, and its folder has gone meanwhile."""
    folder = tmp_path / "mounted"
    folder.mkdir()
    images = active(graph, "tracker_node", "image_raw", queue_depth=0, start_s=5.0,
                    reference_path=str(folder / "reference.mcap"))
    buffered: list[DiagnosticArray] = graph.listen(DiagnosticArray, "/diagnostics")
    folder.rmdir()
    for shot in flight[:6]:
        images.publish(image_message(shot.image, shot.stamp_ns))
    graph.until(lambda: any(value.key == "frames_in" and value.value == "6" for one in buffered
                            for value in one.status[0].values), "all have come")
    reports: list[DiagnosticArray] = graph.listen(DiagnosticArray, "/diagnostics")
    assert change(graph, "tracker_node", DEACTIVATE)
    level, message, state = first_inactive(graph, reports)
    assert (level, state) == (WARN, "INACTIVE")
    assert message.startswith("inactive: takes no images; the reference is not saved: ")


def test_an_evaluator_after_a_message_that_it_refused(graph: Graph, flight: list[Shot]) -> None:
    images = active(graph, "evaluator_node", "image_stabilized", alarm_s=60.0)
    reports: list[DiagnosticArray] = graph.listen(DiagnosticArray, "/diagnostics")
    images.publish(image_message(flight[0].image, 10**9, step=7))
    graph.until(lambda: any("refused a message" in message for _, message, _ in reported(reports, "active")), "it said")
    assert change(graph, "evaluator_node", DEACTIVATE)
    level, message, state = first_inactive(graph, reports)
    assert (level, state) == (WARN, "INACTIVE")
    assert message.startswith("inactive: refused a message: ")
    assert "waiting" not in message


def test_a_discharge_node_with_a_doubtful_section(graph: Graph, tmp_path: Path) -> None:
    """Nobody publishes water levels or velocities either, which is no fault yet."""
    path = Path(section_file(tmp_path))
    path.write_text(path.read_text().replace("X,Y,Z", "X (ft),Y (ft),Z (ft)"))
    reports: list[DiagnosticArray] = graph.listen(DiagnosticArray, "/diagnostics")
    graph.start("discharge_node", autostart=False, section_file=str(path))
    assert change(graph, "discharge_node", CONFIGURE)
    remark = f"{path}: X (ft), Y (ft), Z (ft) read as feet, and made metres"
    assert first_inactive(graph, reports) == (WARN, f"inactive: takes no velocities; {remark}", "INACTIVE")
