"""The evaluator as users run it: a separate process over DDS."""

from __future__ import annotations

import math
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, NodeProcess, stamp_ns, values_of
from live_stream import StabilizedStream, name_of, still
from rclpy.qos import DurabilityPolicy, QoSProfile
from recordings import RECORDERS
from std_msgs.msg import Float64

from stab_ros.core.types import Gray
from stab_ros.evaluation.frame_metrics import POINT_METRICS, UNITS
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.jobs.evaluate import EvaluationJob, evaluate
from stab_ros.synthetic.flight import Flight, Shot, preset

CONFIG = Path(__file__).parents[2] / "config" / "evaluator.yaml"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SIZE = (400, 300)
METRICS = "/cam/evaluator_node/metrics"
ERROR, WARN, OK = b"\x02", b"\x01", b"\x00"


@pytest.fixture(scope="module")
def shots() -> list[Shot]:
    """Fourteen frames over an alpine river."""
    return list(Flight(preset("alpine"), size=SIZE, frames=14, seed=5))


@pytest.fixture(scope="module")
def ground(shots: list[Shot]) -> Gray:
    """An image with a margin, from which `still` crops one."""
    return np.asarray(np.pad(shots[0].image, 8, mode="reflect"))


def offline(bag: Path) -> TopicEvaluation:
    (topic,) = evaluate(EvaluationJob(bag, {}), lambda _done, _total: None).topics
    return topic


def test_live_gives_what_the_command_gives(graph: Graph, shots: list[Shot], tmp_path: Path) -> None:
    flown, recorded = RECORDERS["mcap"](tmp_path, shots), tmp_path / "live.mcap"
    heard = graph.listen(DiagnosticArray, METRICS)
    plotted = {name: graph.listen(Float64, f"/cam/evaluator_node/{name}")
               for name in ("rmse_px", "rmsd", "displacement_px")}
    evaluator = graph.start("evaluator_node", "/cam", wait_for_subscribers=1)
    recorder = graph.start("bag_recorder_node", output=str(recorded),
                           topics=["/cam/homography", "/cam/image_stabilized"])
    tracker = graph.start("tracker_node", "/cam", queue_depth=0, wait_for_subscribers=2, start_s=0.0)
    player = graph.start("bag_player_node", bag=str(flown), wait_for_subscribers=1, rate=100.0)
    assert player.wait() == 0
    graph.until(lambda: len(heard) == len(shots), "every frame measured")
    graph.until(lambda: len(plotted["displacement_px"]) == len(shots) - 1, "the last value")
    assert (tracker.stop(), evaluator.stop(), recorder.stop(signal.SIGTERM)) == (0, 0, 0)

    topic = offline(recorded)
    names = [point.name for point in topic.points]
    assert [stamp_ns(one) for one in heard] == [row.stamp_ns for row in topic.rows] == [s.stamp_ns for s in shots]
    for message, row in zip(heard, topic.rows, strict=True):
        live = values_of(message)
        expected: dict[str, float | None] = {name: row[name] for name in UNITS}
        for name in POINT_METRICS:
            of_points = row.points[name].tolist()
            expected |= {f"{name}.{point}": value for point, value in zip(names, of_points, strict=False)}
        assert (live.pop("outcome"), live.pop("frame")) == (row.outcome.value, str(row.frame))
        assert live.keys() == expected.keys()
        for key, value in expected.items():
            measured = float(live[key]) if live[key] else math.nan
            assert measured == pytest.approx(math.nan if value is None else value, abs=1e-6, nan_ok=True), key
    for topic_name, name in (("rmse_px", "rmse_reference_px"), ("rmsd", "rmsd_reference"),
                             ("displacement_px", "displacement_reference_px")):
        assert [one.data for one in plotted[topic_name]] == pytest.approx(topic.series(name), abs=1e-6)
    assert topic.series("rmse_reference_px")


def level_of(message: Any) -> tuple[bytes, str]:
    return message.status[0].level, message.status[0].message


def evaluator_of(graph: Graph, **parameters: Any) -> tuple[NodeProcess, list[Any], list[Any]]:
    """The node, and what it says on `~/metrics` and on /diagnostics."""
    heard = graph.listen(DiagnosticArray, METRICS), graph.listen(DiagnosticArray, "/diagnostics")
    return graph.start("evaluator_node", "/cam", wait_for_subscribers=1, **parameters), *heard


def test_problems_raise_the_level_and_name_the_frame(graph: Graph, ground: Gray) -> None:
    evaluator, metrics, diagnostics = evaluator_of(graph, alarm_s=1.0, stale_s=1000.0)
    stream = StabilizedStream(graph, ground)

    def calm() -> None:
        stream.send(3)
        graph.until(lambda: len(metrics) == stream.number, "every frame measured")
        quiet = OK, f"no problem up to {name_of(stream.number - 1)}"
        graph.until(lambda: diagnostics and level_of(diagnostics[-1]) == quiet, "calm")

    def alarmed(said: str) -> None:
        graph.until(lambda: any(level == ERROR and said in text for level, text in map(level_of, diagnostics)), said)

    calm()
    jumped = stream.send(shift_px=3)
    alarmed(f"{name_of(jumped)}: displaced by ")
    calm()
    lost = stream.send(lost=True)
    alarmed(f"{name_of(lost)} is lost")
    calm()
    picture = still(ground, 1000)
    frozen = stream.send(4, shown=picture)
    alarmed(f"{name_of(frozen)}: the picture is frozen")
    calm()
    values = values_of(diagnostics[-1])
    assert (values["state"], values["frames_in"], values["frames_lost"]) == ("MEASURING", str(stream.number), "1")
    assert int(values["frames_measured"]) == stream.number - 2  # neither the reference nor what was lost
    assert float(values["displacement_reference_px.max"]) == pytest.approx(3, abs=0.3)
    assert evaluator.stop() == 0
