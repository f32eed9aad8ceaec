"""ROS parameters made from settings dataclasses: descriptors, overrides at start, changes at run time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.settings import Range, Value, checked, did_you_mean
from stab_ros.parameters.table import Parameter, parameters_of

_OF_ROS = ("use_sim_time", "start_type_description_service")
_LARGEST_INTEGER = 2**63 - 1


def table_of(settings: type[Any]) -> dict[str, Parameter]:
    """The parameters that the fields of a settings dataclass define."""
    return {parameter.name: parameter for parameter in parameters_of(settings)}


def declare(node: Node, table: Mapping[str, Parameter], changeable: Collection[str] = ()) -> dict[str, Value]:
    """Declares `table` and returns the values in force; all but `changeable` are read-only.

    The node must have declared its overrides itself (`automatically_declare_parameters_from_overrides`).

    Raises:
        ConfigError: an override has the wrong type or is out of range.
    """
    values = {name: _take_override(node, parameter) for name, parameter in table.items()}
    for name, value in values.items():
        shown = describe(table[name].limits, value, read_only=name not in changeable)
        node.declare_parameter(name, value, shown, ignore_override=True)
    return values


def given(node: Node, name: str) -> object:
    """The override of a parameter before `declare` has checked it; None: there is none."""
    return node.get_parameter(name).value if node.has_parameter(name) else None


def _take_override(node: Node, parameter: Parameter) -> Value:
    if not node.has_parameter(parameter.name):
        return parameter.default
    given = node.get_parameter(parameter.name).value
    node.undeclare_parameter(parameter.name)
    return checked(parameter.name, given, parameter.default, parameter.limits)


def declare_names(node: Node, name: str, doc: str) -> list[str]:
    """Declares a read-only list of strings, empty by default; a single string counts as a list of one.

    Raises:
        ConfigError: the override is something else.
    """
    given = node.get_parameter(name).value if node.has_parameter(name) else []
    names = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [given]
    if not all(isinstance(one, str) for one in names):
        raise ConfigError(f"{name}: {given!r} must be a list of names, as in -p {name}:=[/a,/b]")
    if node.has_parameter(name):
        node.undeclare_parameter(name)
    shown = ParameterDescriptor(description=doc, read_only=True)
    node.declare_parameter(name, names or RosParameter.Type.STRING_ARRAY, shown, ignore_override=True)
    return names


def describe(limits: Range, value: Value, read_only: bool) -> ParameterDescriptor:
    """The descriptor, which `ros2 param describe` and rqt show."""
    shown = ParameterDescriptor(description=limits.doc, read_only=read_only)
    if limits.choices:
        shown.additional_constraints = f"one of {', '.join(limits.choices)}"
    if limits.low is None and limits.high is None:
        return shown
    if isinstance(value, float):
        most = sys.float_info.max
        bounds = (-most if limits.low is None else limits.low, most if limits.high is None else limits.high)
        shown.floating_point_range = [FloatingPointRange(from_value=float(bounds[0]), to_value=float(bounds[1]))]
    else:
        low = -_LARGEST_INTEGER if limits.low is None else int(limits.low)
        high = _LARGEST_INTEGER if limits.high is None else int(limits.high)
        shown.integer_range = [IntegerRange(from_value=low, to_value=high)]
    return shown


def warn_of_unknown(node: Node, known: Collection[str]) -> None:
    """Logs every override of a parameter that the node does not have, with similar names."""
    for name in node.get_parameters_by_prefix(""):
        if name in known or name in _OF_ROS or name.startswith("qos_overrides."):
            continue
        meant = did_you_mean(name, known)
        node.get_logger().warning(f"parameter {name} is unknown and has no effect{meant and f'; {meant}'}")


class ParameterUpdates:
    """Applies changes of parameters at run time: `take` applies all of them, or raises InputError and changes none."""

    def __init__(self, node: Node, table: Mapping[str, Parameter], take: Callable[[dict[str, Value]], None]) -> None:
        self._table = table
        self._take = take
        node.add_pre_set_parameters_callback(self._as_declared)
        node.add_on_set_parameters_callback(self._apply)

    def _as_declared(self, changed: list[RosParameter]) -> list[RosParameter]:
        """Integers that were given for floats, as by `ros2 param set ... 1`, as floats, and lists for text as text."""
        return [self._of_its_type(one) for one in changed]

    def _of_its_type(self, one: RosParameter) -> RosParameter:
        declared = self._table.get(one.name)
        if declared is None:
            return one
        try:
            return RosParameter(one.name, value=checked(one.name, one.value, declared.default, Range("")))
        except ConfigError:  # rclpy says what its type must be
            return one

    def _apply(self, changed: list[RosParameter]) -> SetParametersResult:
        ours = {one.name: one.value for one in changed if one.name in self._table}
        if not ours:  # as where rclpy declares the quality of service of a new subscription
            return SetParametersResult(successful=True)
        try:
            self._take(ours)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)
