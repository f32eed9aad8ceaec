"""Calls of the middleware that may last do not hold up the other threads of a node."""

from __future__ import annotations

import signal
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from live_graph import Graph
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from stab_ros.nodes.unlocked_calls import acknowledged_unlocked, publish_unlocked

STEP_NS = 1_000_000_000


def test_other_threads_go_on_while_nobody_acknowledges(graph: Graph, tmp_path: Path) -> None:
    publisher = graph.node.create_publisher(String, "/words", QoSProfile(depth=1))
    recorder = graph.run("stab-ros", ["record", str(tmp_path / "words.mcap"), "/words"], ("-m", "stab_ros"))
    graph.until(publisher.get_subscription_count, "the recorder")
    recorder.process.send_signal(signal.SIGSTOP)
    publish_unlocked(publisher, serialize_message(String(data="still")))
    with ThreadPoolExecutor(1) as pool:
        assert steps_during(pool.submit(acknowledged_unlocked, publisher, STEP_NS)) > 10
        assert not acknowledged_unlocked(publisher, STEP_NS)
        recorder.process.send_signal(signal.SIGCONT)
        graph.until(lambda: acknowledged_unlocked(publisher, STEP_NS), "the acknowledgement")
    assert recorder.stop() == 0


def steps_during(work: Future[bool]) -> int:
    """How often this thread has its turn meanwhile."""
    steps = 0
    while not work.done():
        time.sleep(1e-3)  # gives the other thread its turn, which would keep it
        steps += 1
    return steps
