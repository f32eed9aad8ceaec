"""A recording through the live nodes: player, tracker, evaluator and recorder as processes, over DDS."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CameraInfo

from stab_ros.core.errors import WorkError
from stab_ros.core.settings import Value
from stab_ros.demo.news import News
from stab_ros.demo.processes import PLAYER, Node, started
from stab_ros.demo.stages import bar
from stab_ros.io.topics import (
    CAMERA_INFO_TOPIC,
    DEFAULT_NAMESPACE,
    DIAGNOSTICS_TOPIC,
    HOMOGRAPHY_TOPIC,
    METRICS_TOPIC,
    RAW_COMPRESSED_TOPIC,
    STABILIZED_TOPIC,
    STATIC_MAP_TOPIC,
    TRACK_TOPIC,
    TRACKER_NAME,
    topic_in,
)
from stab_ros.nodes.bag_player_node import PlayerSettings

HOMOGRAPHY, TRACK, STABILIZED, METRICS, RAW, _CAMERA_INFO = (
    topic_in(DEFAULT_NAMESPACE, topic) for topic in (HOMOGRAPHY_TOPIC, TRACK_TOPIC, STABILIZED_TOPIC, METRICS_TOPIC,
                                                     RAW_COMPRESSED_TOPIC, CAMERA_INFO_TOPIC))
_STATIC_MAP = topic_in(topic_in(DEFAULT_NAMESPACE, TRACKER_NAME), STATIC_MAP_TOPIC)
RECORDER, TRACKER, EVALUATOR = "bag_recorder_node", "tracker_node", "evaluator_node"
_PASSED_ON = (RAW, _CAMERA_INFO, "/gps/fix")
_STEP_NS = 100_000_000
_FIRST_DOMAIN, _DOMAINS = 215, 18  # domains outside of the ephemeral ports of Linux, and rarely used


@dataclass(frozen=True)
class Replay:
    """A replay. frames: number of images in the recording. output: the bag to record. log: folder of the nodes' logs.

    rate: of the player, relative to real time. judging: parameters of the evaluator.

    Raises:
        ConfigError: the rate is out of range.
    """

    recording: Path
    frames: int
    output: Path
    log: Path
    rate: float
    judging: Mapping[str, Value]

    def __post_init__(self) -> None:
        PlayerSettings(str(self.recording), self.rate)


def replay(job: Replay) -> int:
    """Plays, tracks, evaluates and records until every frame is answered or the nodes are idle.

    Returns:
        The number of answered frames.

    Raises:
        WorkError: a node failed, or the nodes hang.
    """
    _prepare(job.log)
    topics = [HOMOGRAPHY, TRACK, STABILIZED, METRICS, _STATIC_MAP, *_PASSED_ON]
    with ExitStack() as stack:
        recorder = stack.enter_context(
            started(RECORDER, job.log, {"output": str(job.output), "overwrite": True, "topics": topics}))
        tracker = stack.enter_context(started(TRACKER, job.log, {
            "image_transport": "compressed", "queue_depth": 0, "wait_for_subscribers": 3,
        }, f"__ns:={DEFAULT_NAMESPACE}", "~/track:=track"))
        # recorder and listener must not miss a frame: the evaluator waits for both, and the tracker for all three
        evaluator = stack.enter_context(started(
            EVALUATOR, job.log, {**job.judging, "wait_for_subscribers": 2}, f"__ns:={DEFAULT_NAMESPACE}",
            "~/metrics:=metrics"))
        listener = stack.enter_context(_Listener.subscribed())
        player = stack.enter_context(started(
            PLAYER, job.log, {"bag": str(job.recording), "rate": job.rate, "wait_for_subscribers": 2}))
        listener.wait_for(job.frames, player, (recorder, tracker, evaluator))
        # the tracker last: its last image may still be on the way to the recorder
        for node in (player, recorder, evaluator, tracker):
            node.end()
        return listener.count


def _prepare(log: Path) -> None:
    """Sets a separate DDS domain on this machine, and removes the logs of an earlier run."""
    log.mkdir(exist_ok=True)
    for earlier in (*log.glob("*.log"), *log.glob("*_node.txt")):
        earlier.unlink()
    domain = _FIRST_DOMAIN + os.getpid() % _DOMAINS
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST",
                      ROS_LOG_DIR=str(log.resolve()))


class _Listener:
    """Counts the homographies and metrics, and follows the diagnostics of the nodes."""

    def __init__(self, executor: SingleThreadedExecutor) -> None:
        self._counts = {HOMOGRAPHY: 0, METRICS: 0}
        self._executor = executor
        self._news = News((PLAYER, RECORDER, TRACKER, EVALUATOR))

    @property
    def count(self) -> int:
        """Number of frames with both a homography and metrics."""
        return min(self._counts.values())

    @classmethod
    @contextmanager
    def subscribed(cls) -> Iterator[_Listener]:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node, executor = rclpy.create_node("demo"), SingleThreadedExecutor()
        try:
            answers = cls(executor)
            keep_all = QoSProfile(history=HistoryPolicy.KEEP_ALL)
            for msg_class, topic in ((CameraInfo, HOMOGRAPHY), (DiagnosticArray, METRICS)):
                node.create_subscription(msg_class, topic, partial(answers._add, topic), keep_all, raw=True)
            node.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, answers._hear, keep_all)
            executor.add_node(node)
            yield answers
        finally:
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()

    def wait_for(self, frames: int, player: Node, others: tuple[Node, ...]) -> None:
        """Shows progress until there are `frames` answers, or the flight is over and the nodes are idle.

        Raises:
            WorkError: a node failed, or the nodes make no progress.
        """
        with bar("replay") as progress:
            while not self._are_complete(frames, player):
                self._spin()
                progress(self.count, frames)
                for node in (player, *others):
                    node.check()
                if self._news.hang:
                    raise WorkError(f"{self.count} of {frames} frames were answered, then {self._news.hang}")

    def _are_complete(self, frames: int, player: Node) -> bool:
        return player.ended and (self.count >= frames or self._news.are_idle((RECORDER, TRACKER, EVALUATOR)))

    def _spin(self) -> None:
        before_ns = time.monotonic_ns()
        self._executor.spin_once(timeout_sec=_STEP_NS / 1e9)
        self._news.waited(time.monotonic_ns() - before_ns, _STEP_NS)

    def _add(self, topic: str, _message: bytes) -> None:
        self._counts[topic] += 1
        self._news.moved()

    def _hear(self, message: Any) -> None:
        for status in message.status:
            self._news.on_report(status.name, status.message, {pair.key: pair.value for pair in status.values})
