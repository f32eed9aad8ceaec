"""Several nodes in one process: images come once for all of them, and each node works on a thread of its own."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from rclpy.executors import SingleThreadedExecutor

from stab_ros.core.errors import ConfigError, InputError, StabRosError, WorkError
from stab_ros.core.settings import Range, checked
from stab_ros.core.text import counted
from stab_ros.nodes import params
from stab_ros.nodes.background_compilation import BackgroundCompilation
from stab_ros.nodes.bag_player_node import BagPlayerNode
from stab_ros.nodes.discharge_node import DischargeNode
from stab_ros.nodes.georeference_node import GeoreferenceNode
from stab_ros.nodes.image_hub import ImageHub
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.runtime import spin, started
from stab_ros.nodes.stopping import StopRequest
from stab_ros.nodes.tracker_node import TrackerNode
from stab_ros.nodes.velocimetry_node import VelocimetryNode
from stab_ros.parameters.node_settings import PipelineSettings

NODES: Mapping[str, type[TrackerNode | GeoreferenceNode | VelocimetryNode | DischargeNode | BagPlayerNode]] = {
    "tracker": TrackerNode, "georeference": GeoreferenceNode, "velocimetry": VelocimetryNode,
    "discharge": DischargeNode, "player": BagPlayerNode}
SETTINGS = params.table_of(PipelineSettings)
_WAIT_S = 0.1  # until a signal is noticed
_SWITCH_S = 0.0005  # a tracker that comes back from a kernel waits no longer for another node's Python code


class PipelineNode(ImageHub):
    """Takes the images for the nodes that its parameter names. nodes: those names."""

    def __init__(self) -> None:
        super().__init__("pipeline_node")
        values = params.declare(self, SETTINGS)
        self.nodes = names_in(str(values["nodes"]))
        self.awaited = awaited_of(self.nodes, int(values["wait_for_nodes"]))

    @property
    def parameters(self) -> Collection[str]:
        """See `ImageSource`."""
        return SETTINGS


def names_in(text: str) -> list[str]:
    """The nodes in a list of them, each once, in the order of the list.

    Raises:
        ConfigError: which of them is none, or comes twice; or there is none.
    """
    names = text.strip("[] ").replace(",", " ").split()
    for name in names:
        checked("nodes", name, "", Range("", choices=tuple(NODES)))
    if not names or len({*names}) < len(names):
        raise ConfigError(f"nodes: {text!r} must name each node once, and one at least, as [tracker, velocimetry]")
    return names


def awaited_of(nodes: Sequence[str], wait_for_nodes: int) -> int:
    """How many of the nodes must be ready for images before any is taken: all, where one of them plays a recording.

    Raises:
        ConfigError: fewer of them take images than are waited for.
    """
    takers = [name for name in nodes if NODES[name].TAKES_IMAGES]
    if wait_for_nodes > len(takers):
        raise ConfigError(f"wait_for_nodes: {wait_for_nodes} is out of range, it must lie in [0, {len(takers)}], as "
                          f"{counted(len(takers), 'node')} of {', '.join(nodes)} take images")
    return wait_for_nodes or len(takers) * ("player" in nodes)


def run(stop: StopRequest) -> int:
    """Runs the pipeline from start to end; exit code 0.

    Raises:
        InputError: bad ROS arguments or parameters. WorkError: the work of a node broke off.
    """
    sys.setswitchinterval(_SWITCH_S)
    with started(stop) as process:
        hub = PipelineNode()
        nodes = [_made(name, hub) for name in hub.nodes]
        _check_names([hub, *nodes])
        computes = any(node.COMPUTES for node in nodes)
        _spin_all(hub, nodes, stop, process.prepare([hub, *nodes], hub.get_logger(), computes))
    return 0


def _made(name: str, hub: ImageHub) -> StabNode:
    try:
        node = NODES[name](images=hub)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    node.waits = True
    return node


def _check_names(nodes: Sequence[PipelineNode | StabNode]) -> None:
    """Raises InputError if several nodes have the same full name."""
    names = [node.get_fully_qualified_name() for node in nodes]
    if len({*names}) < len(names):
        raise InputError(f"all nodes of the process were given the name {names[0]}; rename one alone, as "
                         "-r tracker_node:__node:=NAME")


def _spin_all(hub: PipelineNode, nodes: Sequence[StabNode], stop: StopRequest,
              compilation: BackgroundCompilation | None) -> None:
    """Each node on a thread, as in a process of its own; the images come on this one, which also gets the signals."""
    executor = SingleThreadedExecutor()
    executor.add_node(hub)
    with ThreadPoolExecutor(len(nodes), "node") as threads:
        work = [threads.submit(_spin_one, node, hub, compilation if node.COMPUTES else None) for node in nodes]
        try:
            while not (stop.requested or _is_over(work)):
                executor.spin_once(_WAIT_S)
        finally:
            for node in nodes:
                node.stop.requested = True
    executor.shutdown()
    hub.destroy_node()
    for one in work:
        one.result()


def _is_over(work: Sequence[Future[None]]) -> bool:
    """Whether all nodes have ended, or one of them by an error."""
    ended = [one for one in work if one.done()]
    return len(ended) == len(work) or any(one.exception() is not None for one in ended)


def _spin_one(node: StabNode, hub: PipelineNode, compilation: BackgroundCompilation | None) -> None:
    name, full_name = node.get_name(), node.get_fully_qualified_name()
    try:
        spin(node, compilation)
    except StabRosError as error:
        kind = InputError if isinstance(error, InputError) else WorkError
        raise kind(f"{name}: {error}") from error
    if node.TAKES_IMAGES:
        hub.expect_no_more(full_name)
