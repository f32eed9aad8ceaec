"""A recording through the live nodes: player, tracker, evaluator and recorder as processes, over DDS."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CameraInfo
from tqdm import tqdm

from stab_ros.core.config import Value
from stab_ros.core.errors import WorkError

HOMOGRAPHY, TRACK, STABILIZED = "/camera/homography", "/camera/track", "/camera/image_stabilized"
METRICS = "/camera/metrics"
_PASSED_ON = ("/camera/image_raw/compressed", "/camera/camera_info", "/gps/fix")
_STEP_S = 0.1
_PATIENCE_S = 120.0  # without news for so long, something hangs; the first start compiles the kernels
_END_S = 15.0  # what a node may take to end
_FIRST_DOMAIN, _DOMAINS = 215, 18  # whose ports Linux gives to nobody else, and which few choose


def replay(recording: Path, output: Path, log: Path, frames: int, evaluator_values: Mapping[str, Value]) -> None:
    """Plays `recording`, tracks and judges its `frames` images, records all to `output`; the nodes' words go to `log`.

    Raises:
        WorkError: a node failed, or the answers stopped coming.
    """
    _prepare(log)
    topics = [HOMOGRAPHY, TRACK, STABILIZED, METRICS, *_PASSED_ON]
    with ExitStack() as stack:
        recorder = stack.enter_context(
            _node("bag_recorder_node", log, {"output": str(output), "overwrite": True, "topics": topics}))
        tracker = stack.enter_context(_node("tracker_node", log, {
            "image_transport": "compressed", "queue_depth": 0, "wait_for_subscribers": 3,
        }, "__ns:=/camera", "~/track:=track"))
        # recorder and `answers` must not miss a frame: the evaluator waits for both, and the tracker for all three
        evaluator = stack.enter_context(_node(
            "evaluator_node", log, {**evaluator_values, "wait_for_subscribers": 2}, "__ns:=/camera",
            "~/metrics:=metrics"))
        answers = stack.enter_context(_Answers.subscribed())
        player = stack.enter_context(_node("bag_player_node", log, {"bag": str(recording), "wait_for_subscribers": 2}))
        answers.wait_for(frames, (recorder, tracker, evaluator, player))
        # the tracker last: its last picture may be on the way to the recorder
        for node in (player, recorder, evaluator, tracker):
            node.end()


def _prepare(log: Path) -> None:
    """Our own DDS domain on this machine, so that nobody else's nodes meet ours; logs of an earlier run go."""
    log.mkdir(exist_ok=True)
    for earlier in (*log.glob("*.log"), *log.glob("*_node.txt")):
        earlier.unlink()
    domain = _FIRST_DOMAIN + os.getpid() % _DOMAINS
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST",
                      ROS_LOG_DIR=str(log.resolve()))


class _Node:
    """A node's process; `end` asks it to finish and wants exit code 0."""

    def __init__(self, name: str, process: subprocess.Popen[bytes], said: Path) -> None:
        self.name = name
        self._process = process
        self._said = said

    def check(self) -> None:
        """Raises WorkError if the node ended with an error."""
        code = self._process.poll()
        if code:
            lines = self._said.read_text(encoding="utf-8", errors="replace").split("\n")
            last = next((line for line in reversed(lines) if line.strip()), "it said nothing")
            raise WorkError(f"{self.name} ended with code {code}: {last} (see {self._said})")

    def end(self) -> None:
        if self.name != "bag_player_node":  # which ends by itself
            self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired as error:
            raise WorkError(f"{self.name} did not end within {_END_S:g} s (see {self._said})") from error
        self.check()


@contextmanager
def _node(name: str, log: Path, parameters: Mapping[str, object], *remaps: str) -> Iterator[_Node]:
    """Starts what the executable of this name runs; in a session of its own, as Ctrl-C is for us."""
    words = [sys.executable, "-m", f"stab_ros.nodes.{name.removesuffix('_node')}", "--ros-args"]
    for rule in remaps:
        words += ["-r", rule]
    for key, value in parameters.items():
        words += ["-p", f"{key}:={json.dumps(value)}"]
    said = log / f"{name}.txt"
    process: subprocess.Popen[bytes] | None = None
    try:
        with said.open("wb") as output, _signals_wait():
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                                       start_new_session=True)
        yield _Node(name, process, said)
    finally:
        if process is not None:
            _stop(process)


@contextmanager
def _signals_wait() -> Iterator[None]:
    """A Ctrl-C takes effect at the end: in the midst of starting a process it would leave one that nobody knows."""
    caught: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda caught_now, _: caught.append(caught_now)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if caught:
        raise KeyboardInterrupt


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Ends what still runs after a failure."""
    process.terminate()  # no effect where it has ended
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class _Answers:
    """Counts the homographies and the metrics as they come."""

    def __init__(self, executor: SingleThreadedExecutor) -> None:
        self._counts = {HOMOGRAPHY: 0, METRICS: 0}
        self._executor = executor

    @property
    def count(self) -> int:
        """How many frames have been answered by both."""
        return min(self._counts.values())

    @classmethod
    @contextmanager
    def subscribed(cls) -> Iterator[_Answers]:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node, executor = rclpy.create_node("demo"), SingleThreadedExecutor()
        try:
            answers = cls(executor)
            keep_all = QoSProfile(history=HistoryPolicy.KEEP_ALL)
            for msg_class, topic in ((CameraInfo, HOMOGRAPHY), (DiagnosticArray, METRICS)):
                node.create_subscription(msg_class, topic, partial(answers._add, topic), keep_all, raw=True)
            executor.add_node(node)
            yield answers
        finally:
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()

    def wait_for(self, frames: int, nodes: tuple[_Node, ...]) -> None:
        """Shows progress until there are `frames` answers.

        Raises:
            WorkError: a node failed, or no answer has come for long.
        """
        news_s = time.monotonic()
        with tqdm(total=frames, unit=" frames", desc="live", disable=None) as progress:
            while self.count < frames:
                before = self.count
                self._executor.spin_once(timeout_sec=_STEP_S)
                for node in nodes:
                    node.check()
                if self.count > before:
                    news_s = time.monotonic()
                    progress.update(self.count - before)
                elif time.monotonic() - news_s > _PATIENCE_S:
                    raise WorkError(f"{self.count} of {frames} frames were answered, then nothing came for "
                                    f"{_PATIENCE_S:g} s")

    def _add(self, topic: str, _message: bytes) -> None:
        self._counts[topic] += 1
