"""The one way to an engine from parameters, for nodes and commands alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import yaml

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.text import one_line
from stab_ros.evaluation.evaluator import Evaluator
from stab_ros.imaging.camera import Camera
from stab_ros.io.points import read_points, read_tracking_points
from stab_ros.io.regions import read_area
from stab_ros.io.static_maps import read_static_map
from stab_ros.parameters.table import (
    EVALUATOR_PARAMETERS,
    PARAMETERS,
    Table,
    checked_values,
    evaluator_config,
    stabilizer_config,
)
from stab_ros.tracking.stabilizer import Stabilizer

TRACKER, EVALUATOR = "tracker_node", "evaluator_node"

# beginnings of what the nodes alone read: the same file serves `--params-file` and `--config`
_OF_THE_NODES = ("queue_depth", "image_transport", "wait_for_subscribers", "stale_s", "reference_path", "use_sim_time",
                 "qos_overrides.", "alarm_s", "window_s", "backlog_mb")
_OF_ALL_NODES = ("/**", "/*")
_CONFIG_LIMIT = 2**17  # characters of a parameter file: pure Python reads 100,000 a second
_TABLES = {TRACKER: PARAMETERS, EVALUATOR: EVALUATOR_PARAMETERS}


def make_stabilizer(values: Mapping[str, Value], camera: Camera | None = None) -> Stabilizer:
    """An engine with the defaults overridden by `values`.

    Raises:
        InputError: a value, a region or the points are wrong.
    """
    return Stabilizer(stabilizer_config(values), read_area(values), camera, read_tracking_points(values),
                      read_static_map(values))


def reconfigure(stabilizer: Stabilizer, values: Mapping[str, Value]) -> None:
    """The engine's settings as `make_stabilizer` would make them; unchanged if that fails.

    Raises:
        InputError: a value, a region or the points are wrong, or do not fit the reference.
    """
    stabilizer.reconfigure(stabilizer_config(values), read_area(values), read_tracking_points(values))


def make_evaluator(values: Mapping[str, Value]) -> Evaluator:
    """An evaluator with the defaults overridden by `values`.

    Raises:
        InputError: a value, a region or the file of points is wrong.
    """
    points_file = values.get("points_file", "")
    points = read_points(Path(str(points_file))) if points_file else ()
    return Evaluator(evaluator_config(values), points, read_area(values))


def read_config(path: Path, node: str = TRACKER) -> dict[str, Value]:
    """The parameters of `node` in a ROS parameter file: every `ros__parameters` under `/**` or a name of that node.

    Under `/**` may also stand what another node of ours knows.

    Raises:
        InputError: the file is missing, no ROS parameter file or for other nodes, or a parameter in it is wrong.
    """
    nodes = list(_nodes(_document(path)))
    if not nodes:
        raise InputError(f"{path}: not a ROS parameter file, it must hold '/**: ros__parameters: name: value'")
    ours = [(name, parameters) for name, parameters in nodes if name.endswith((*_OF_ALL_NODES, f"/{node}"))]
    if not ours:
        named = one_line(", ".join(name for name, _ in nodes))[:500]
        raise InputError(f"{path}: holds parameters of {named}, it must hold some of /** or of a {node}")
    found: dict[str, object] = {}
    for name, parameters in ours:
        shared = name.endswith(_OF_ALL_NODES)
        found.update({key: value for key, value in _flat(path, parameters).items()
                      if not (shared and _is_foreign(key, node))})
    return checked_values({name: value for name, value in found.items() if not name.startswith(_OF_THE_NODES)},
                          _TABLES[node])


class _Loader(yaml.SafeLoader):
    """YAML without aliases, as ROS has it: a few lines of them can stand for billions of values."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError(f"line {self.line + 1}: aliases are not supported")
        return super().compose_node(parent, index)


def _integer(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    """Python's are endless, and slow to print."""
    value: int = loader.construct_yaml_int(node)
    if not -(2**63) <= value < 2**63:
        raise yaml.YAMLError(f"line {node.start_mark.line + 1}: a number does not fit 64 bits")
    return value


_Loader.add_constructor("tag:yaml.org,2002:int", _integer)


def _document(path: Path) -> object:
    """What the file holds."""
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_CONFIG_LIMIT + 1)
        if len(text) > _CONFIG_LIMIT:
            raise ValueError(f"more than {_CONFIG_LIMIT} characters")
        return yaml.load(text, _Loader)
    except (OSError, ValueError, LookupError, AttributeError, TypeError, OverflowError, RecursionError,
            yaml.YAMLError) as error:  # a value that is not of its tag raises nearly anything
        raise InputError(f"{path}: not a readable YAML file ({one_line(error)[:500]})") from error


def _is_foreign(name: str, node: str) -> bool:
    """Whether only another node knows the parameter."""
    tables: Mapping[str, Table] = _TABLES
    return name not in tables[node] and any(name in table for table in tables.values())


def _nodes(tree: object, name: str = "") -> Iterator[tuple[str, object]]:
    """Full name and `ros__parameters` of every node; namespaces may be part of a key or nest."""
    for key, value in tree.items() if isinstance(tree, dict) else ():
        if key == "ros__parameters":
            yield name, value
        else:
            yield from _nodes(value, f"{name}/{key}".replace("//", "/"))


def _flat(path: Path, tree: object, prefix: str = "") -> dict[str, object]:
    """Nested parameters by their full names, `direct: {patches: 300}` as `direct.patches`."""
    if not isinstance(tree, dict):
        raise InputError(f"{path}: ros__parameters must hold 'name: value' pairs")
    flat: dict[str, object] = {}
    for name, value in tree.items():
        flat.update(_flat(path, value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value})
    return flat
