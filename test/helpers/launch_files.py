"""What launch files start, without ROS's launch, which is not among the wheels.

They are executed with the few classes that they use, whose meaning is written out here: a description is resolved to
the command lines that `ros2 launch` would run.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class StartedNode:
    """A node that a launch file starts. parameters: files and values, in their order. remappings: from, to."""

    package: str
    executable: str
    namespace: str
    parameters: list[Path | dict[str, Any]]
    remappings: list[tuple[str, str]]

    @property
    def ros_arguments(self) -> list[str]:
        """As launch_ros gives them to the executable."""
        words = ["--ros-args", *(["-r", f"__ns:={self.namespace}"] if self.namespace else [])]
        for given in self.parameters:
            words += ["--params-file", str(given)] if isinstance(given, Path) else [
                word for name, value in given.items() for word in ("-p", f"{name}:={yaml_of(value)}")]
        return words + [word for source, target in self.remappings for word in ("-r", f"{source}:={target}")]


def yaml_of(value: Any) -> str:
    """In one line."""
    return str(yaml.safe_dump(value, default_flow_style=True, width=10_000)).removesuffix("\n").removesuffix("\n...")


class _Substitution:
    def resolved(self, arguments: Mapping[str, str]) -> str:
        raise NotImplementedError

    def perform(self, context: Mapping[str, str]) -> str:
        """As launch calls it; a context is the arguments here."""
        return self.resolved(context)


@dataclass
class LaunchConfiguration(_Substitution):
    """The value of an argument."""

    name: str

    def resolved(self, arguments: Mapping[str, str]) -> str:
        return arguments[self.name]


@dataclass
class PathJoinSubstitution(_Substitution):
    """A path of parts."""

    parts: Sequence[Any]

    def resolved(self, arguments: Mapping[str, str]) -> str:
        return str(Path(*(text_of(part, arguments) for part in self.parts)))


@dataclass
class PythonExpression(_Substitution):
    """The value of an expression."""

    parts: Sequence[Any]

    def resolved(self, arguments: Mapping[str, str]) -> str:
        return str(eval("".join(text_of(part, arguments) for part in self.parts), {}))  # of our own launch files


@dataclass
class FindPackageShare(_Substitution):
    """Where this package is installed: here."""

    package: str

    def resolved(self, arguments: Mapping[str, str]) -> str:
        assert self.package == "stab_ros"
        return str(ROOT)


@dataclass
class ParameterValue:
    """A value of a given type."""

    value: Any
    value_type: type = str


@dataclass
class IfCondition:
    """Whether an action takes place."""

    value: Any


@dataclass
class DeclareLaunchArgument:
    """An argument, with its default if it has one."""

    name: str
    default_value: Any = None
    description: str = ""


@dataclass
class IncludeLaunchDescription:
    """Another launch file, with arguments of its own."""

    source: Any
    launch_arguments: Iterable[tuple[str, Any]] = ()


@dataclass
class OpaqueFunction:
    """Actions that are made once the arguments are known."""

    function: Callable[[Mapping[str, str]], list[Any]]


@dataclass
class Node:
    """A node of a package."""

    package: str
    executable: str
    namespace: Any = ""
    parameters: Sequence[Any] = ()
    remappings: Sequence[tuple[Any, Any]] = ()
    condition: IfCondition | None = None
    output: str = "log"


class LaunchContext:
    """In annotations only; here a context is the arguments."""


@dataclass
class LaunchDescription:
    """All actions, in their order."""

    entities: list[Any] = field(default_factory=list)


_MODULES: Mapping[str, Sequence[type]] = {
    "launch": [LaunchContext, LaunchDescription],
    "launch.actions": [DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction],
    "launch.conditions": [IfCondition],
    "launch.substitutions": [LaunchConfiguration, PathJoinSubstitution, PythonExpression],
    "launch_ros": [],
    "launch_ros.actions": [Node],
    "launch_ros.parameter_descriptions": [ParameterValue],
    "launch_ros.substitutions": [FindPackageShare],
}


def text_of(value: Any, arguments: Mapping[str, str]) -> str:
    """A string or a substitution, resolved."""
    return value.resolved(arguments) if isinstance(value, _Substitution) else str(value)


def started(file: Path, **given: str) -> list[StartedNode]:
    """The nodes that `ros2 launch FILE name:=value ...` would start.

    Raises:
        ValueError: an argument has no value, or is none of the file.
    """
    description = _described(file)
    arguments: dict[str, str] = {}
    for one in description.entities:
        if isinstance(one, DeclareLaunchArgument):
            if one.name not in given and one.default_value is None:
                raise ValueError(f"{file.name} needs {one.name}")
            arguments[one.name] = given.get(one.name, text_of(one.default_value, arguments))
    if given.keys() - arguments.keys():
        raise ValueError(f"{file.name} has no argument {', '.join(given.keys() - arguments.keys())}")
    return [node for one in description.entities for node in _nodes_of(one, arguments)]


def described_arguments(file: Path) -> dict[str, str]:
    """The description of each argument that a launch file declares."""
    return {one.name: one.description for one in _described(file).entities if isinstance(one, DeclareLaunchArgument)}


def _described(file: Path) -> LaunchDescription:
    modules = {}
    for name, classes in _MODULES.items():
        modules[name] = ModuleType(name)
        for one in classes:
            setattr(modules[name], one.__name__, one)
    with _importable(modules):
        made = runpy.run_path(str(file))["generate_launch_description"]()
    assert isinstance(made, LaunchDescription)
    return made


@contextmanager
def _importable(modules: Mapping[str, ModuleType]) -> Iterator[None]:
    """Modules of these names in place of others."""
    before = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    try:
        yield
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


def _nodes_of(action: Any, arguments: Mapping[str, str]) -> list[StartedNode]:
    if isinstance(action, IncludeLaunchDescription):
        return started(Path(text_of(action.source, arguments)),
                       **{name: text_of(value, arguments) for name, value in action.launch_arguments})
    if isinstance(action, OpaqueFunction):
        return [node for made in action.function(arguments) for node in _nodes_of(made, arguments)]
    if not isinstance(action, Node) or (
            action.condition is not None and text_of(action.condition.value, arguments).lower() not in ("true", "1")):
        return []
    parameters = [_parameters_of(one, arguments) for one in action.parameters]
    remappings = [(text_of(source, arguments), text_of(target, arguments)) for source, target in action.remappings]
    return [StartedNode(action.package, action.executable, text_of(action.namespace, arguments), parameters,
                        remappings)]


def _parameters_of(given: Any, arguments: Mapping[str, str]) -> Path | dict[str, Any]:
    if isinstance(given, dict):
        return {name: _typed(value, arguments) for name, value in given.items()}
    return Path(text_of(given, arguments))


def _typed(value: Any, arguments: Mapping[str, str]) -> Any:
    """A substitution without a type becomes what YAML makes of its text, as in launch_ros."""
    if isinstance(value, ParameterValue):
        return value.value_type(text_of(value.value, arguments))
    return yaml.safe_load(text_of(value, arguments)) if isinstance(value, _Substitution) else value
