"""Parameters from a ROS parameter file; the same file serves a node's `--params-file` and a command's `--config`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value, settings_of
from stab_ros.core.text import one_line
from stab_ros.io.yaml_file import read_yaml
from stab_ros.parameters.discharge import DISCHARGE_PARAMETERS
from stab_ros.parameters.node_settings import (
    COMPRESSED_PREFIX,
    DischargeSettings,
    EvaluatorSettings,
    GeoreferenceSettings,
    TrackerSettings,
    VelocimetrySettings,
)
from stab_ros.parameters.table import (
    EVALUATOR_PARAMETERS,
    GEOREFERENCE_PARAMETERS,
    PARAMETERS,
    VELOCITY_PARAMETERS,
    Table,
    checked_values,
)

TRACKER, EVALUATOR, GEOREFERENCE = "tracker_node", "evaluator_node", "georeference_node"
VELOCIMETRY, DISCHARGE = "velocimetry_node", "discharge_node"

_TABLES = {TRACKER: PARAMETERS, EVALUATOR: EVALUATOR_PARAMETERS, GEOREFERENCE: GEOREFERENCE_PARAMETERS,
           VELOCIMETRY: VELOCITY_PARAMETERS, DISCHARGE: DISCHARGE_PARAMETERS}
# parameters of the nodes themselves, which the engines do not have; the commands skip them
_OF_THE_NODES = frozenset(
    name for settings in (TrackerSettings, EvaluatorSettings, GeoreferenceSettings, VelocimetrySettings,
                          DischargeSettings)
    for name, _, _ in settings_of(settings))
_OF_ROS, _QOS = "use_sim_time", "qos_overrides."
_OF_ALL_NODES = ("/**", "/*")


def read_config(path: Path, node: str = TRACKER) -> dict[str, Value]:
    """Reads the parameters of a node from a ROS parameter file.

    All `ros__parameters` under `/**` or under a name of the node count. Under `/**` may also stand what only another
    node of this package knows.

    Args:
        path: the YAML file.
        node: the name of the node.

    Returns:
        Value by name, with the types of the parameters.

    Raises:
        InputError: the file is missing, is no ROS parameter file or is for other nodes, or a parameter in it is wrong.
    """
    nodes = list(_nodes(read_yaml(path)))
    if not nodes:
        raise InputError(f"{path}: not a ROS parameter file, it must hold '/**: ros__parameters: name: value'")
    ours = [(name, parameters) for name, parameters in nodes if name.endswith((*_OF_ALL_NODES, f"/{node}"))]
    if not ours:
        named = one_line(", ".join(name for name, _ in nodes))[:500]
        raise InputError(f"{path}: holds parameters of {named}, it must hold some of /** or of a {node}")
    found: dict[str, object] = {}
    foreign: list[str] = []
    for name, parameters in ours:
        flat, shared = _flat(path, parameters), name.endswith(_OF_ALL_NODES)
        foreign += [key for key in flat if shared and _is_foreign(key, node)]
        found.update({key: value for key, value in flat.items() if key not in foreign})
    if foreign and not found:
        raise InputError(f"{path}: holds {one_line(', '.join(foreign))[:500]}, which are of other nodes; it must hold "
                         f"parameters of a {node}")
    return checked_values({name: value for name, value in found.items() if _is_of_an_engine(name)}, _TABLES[node])


def nodes_named(path: Path) -> list[str]:
    """The nodes that a parameter file names, as rcl reads them: `/camera/tracker_node`, `/**/tracker_node`, `/**`.

    Raises:
        InputError: it is missing, or no YAML.
    """
    return [name for name, _ in _nodes(read_yaml(path))]


def _is_foreign(name: str, node: str) -> bool:
    """Whether only the engine of another node has the parameter."""
    tables: Mapping[str, Table] = _TABLES
    return name not in tables[node] and any(name in table for table in tables.values())


def _is_of_an_engine(name: str) -> bool:
    return name not in _OF_THE_NODES and name != _OF_ROS and not name.startswith((_QOS, COMPRESSED_PREFIX))


def _nodes(tree: object, name: str = "") -> Iterator[tuple[str, object]]:
    """Full name and `ros__parameters` of every node; a namespace may be part of a key, or a level of its own."""
    for key, value in tree.items() if isinstance(tree, dict) else ():
        if key == "ros__parameters":
            yield name, value
        else:
            yield from _nodes(value, f"{name}/{key}".replace("//", "/"))


def _flat(path: Path, tree: object, prefix: str = "") -> dict[str, object]:
    """Nested parameters under their full names: `direct: {patches: 300}` becomes `direct.patches`."""
    if not isinstance(tree, dict):
        raise InputError(f"{path}: ros__parameters must hold 'name: value' pairs")
    flat: dict[str, object] = {}
    for name, value in tree.items():
        flat.update(_flat(path, value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value})
    return flat
