"""Nodes as real processes on a DDS domain of their own, and an observer in this process to talk to them."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image as ImageMessage

from stab_ros.core.types import Gray
from stab_ros.nodes.transport import use_profile

_END_S = 15.0  # what a node may take to end
PATIENCE_S = 90.0  # until a condition must hold, on a machine that has other work to do
_workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_turns = itertools.count(os.getppid())


def next_domain() -> int:
    """A DDS domain that no other test is on: processes of pytest-xdist share 100 of them."""
    share = 100 // _workers
    return 1 + _worker * share + next(_turns) % share


class NodeProcess:
    """One of our nodes, running; its output is in a file. program: another one than the node's executable."""

    def __init__(self, name: str, arguments: list[str], environment: Mapping[str, str], log: Path,
                 program: Sequence[str] = ()) -> None:
        words = [sys.executable, *(program or ("-m", f"stab_ros.nodes.{name.removesuffix('_node')}")), *arguments]
        self._log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(words, env=environment, stdout=output, stderr=subprocess.STDOUT)

    @property
    def log(self) -> str:
        return self._log.read_text(errors="replace")

    def wait(self) -> int:
        """Its exit code, once it has ended of itself."""
        return self.process.wait(PATIENCE_S)

    def stop(self, number: int = signal.SIGINT) -> int:
        self.process.send_signal(number)
        return self.wait()


class Graph:
    """What a test sees of a ROS graph that nobody else is on."""

    def __init__(self, folder: Path, domain: int | None = None) -> None:
        self._folder = folder
        use_profile()  # the observer publishes images too
        domain = domain or next_domain()
        self.environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder)}
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("observer", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._processes: list[NodeProcess] = []

    def start(self, name: str, namespace: str = "", remap: Mapping[str, str] | None = None,
              program: Sequence[str] = (), **parameters: object) -> NodeProcess:
        arguments = ["--ros-args"]
        for parameter, value in parameters.items():
            arguments += ["-p", f"{parameter}:={json.dumps(value)}"]
        for rule in {**({"__ns": namespace} if namespace else {}), **(remap or {})}.items():
            arguments += ["-r", ":=".join(rule)]
        return self.run(name, arguments, program)

    def run(self, name: str, arguments: list[str], program: Sequence[str] = ()) -> NodeProcess:
        log = self._folder / f"{len(self._processes)}_{name}.log"
        self._processes.append(NodeProcess(name, arguments, self.environment, log, program))
        return self._processes[-1]

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Runs the observer until the condition holds; fails with the nodes' logs if it never does, or one crashed."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            hopeless = time.monotonic() > deadline_s or any(one.process.poll() == 1 for one in self._processes)
            assert not hopeless, "\n".join([f"never: {what}", *(one.log for one in self._processes)])
            self._executor.spin_once(timeout_sec=0.1)

    def listen(self, msg_class: Any, topic: str, qos: QoSProfile | int = 100) -> list[Any]:
        """The messages of a topic, growing while the observer runs."""
        heard: list[Any] = []
        self.node.create_subscription(msg_class, topic, heard.append, qos)
        return heard

    def speak(self, msg_class: Any, topic: str, qos: QoSProfile | int = 100) -> Any:
        """A publisher that the node under test has subscribed to."""
        publisher = self.node.create_publisher(msg_class, topic, qos)
        self.until(publisher.get_subscription_count, f"a subscriber of {topic}")
        return publisher

    def call(self, service_class: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(service_class, name)
        self.until(client.service_is_ready, f"the service {name}")
        future = client.call_async(request)
        self.until(future.done, f"an answer of {name}")
        return future.result()

    def set_parameter(self, node: str, name: str, value: bool | int | float | str) -> tuple[bool, str]:
        """Whether the node took it, and its reason if not."""
        kinds = {bool: "bool", int: "integer", float: "double", str: "string"}
        kind = kinds[type(value)]
        code = getattr(ParameterType, f"PARAMETER_{kind.upper()}")
        wanted = ParameterMessage(name=name, value=ParameterValue(type=code, **{f"{kind}_value": value}))
        answer = self.call(SetParameters, f"{node}/set_parameters", SetParameters.Request(parameters=[wanted]))
        return answer.results[0].successful, answer.results[0].reason

    def close(self) -> None:
        running = [one.process for one in self._processes if one.process.poll() is None]
        for process in running:  # killed, they would leave their shared memory behind
            process.send_signal(signal.SIGINT)
        for process in running:
            _end(process)
        self.close_observer()

    def close_observer(self) -> None:
        """Also gives back the shared memory of nodes that the observer has read from."""
        if self.context.ok():
            self._executor.shutdown()
            self.node.destroy_node()
            self.context.shutdown()


def _end(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextmanager
def graph_in(folder: Path, domain: int | None = None) -> Iterator[Graph]:
    """domain: None, one that no other test is on."""
    graph = Graph(folder, domain)
    try:
        yield graph
    finally:
        graph.close()


def image_message(gray: Gray, stamp_ns: int, **wrong: object) -> Any:
    """sensor_msgs/Image, mono8; `wrong` replaces fields by what they must not be."""
    message = ImageMessage(height=gray.shape[0], width=gray.shape[1], encoding="mono8", step=gray.shape[1])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    message.header.frame_id = "cam"
    message.data = array("B", gray.tobytes())
    for name, value in wrong.items():
        setattr(message, name, value)
    return message


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def values_of(message: Any) -> dict[str, str]:
    """The keys and values of a DiagnosticArray with one status."""
    (status,) = message.status
    return {pair.key: pair.value for pair in status.values}
