"""ROS parameters made from settings dataclasses: descriptors, overrides at start, changes at run time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.settings import Range, Value, checked, did_you_mean
from stab_ros.nodes.qos_overrides import PREFIX
from stab_ros.parameters.table import Parameter, parameters_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import RosOptions

_BOOLS_OF_RCLPY = ("use_sim_time", "start_type_description_service")
_OF_EVERY_NODE = (*_BOOLS_OF_RCLPY, "autostart")
_SIM_TIME = "Whether the time of diagnostics and recordings is that of /clock; results are timed by header stamps"
_LARGEST_INTEGER = 2**63 - 1


class DeclaringNode(Node):
    """A node that declares its parameters by `declare`.

    Attributes:
        defaulted: parameters that nobody has given, by name, and their defaults.
        fixed: those that a configured node cannot change.
        autostart: whether it configures itself; if not, nothing is read-only.
        others: names of parameters that reach it, but are for another node of its process.
        first_name: what it would be called without any rule that renames it.
    """

    OF_BAGS: ClassVar[bool] = False  # whether its topics are those of recordings, and no others

    def __init__(self, name: str, given: Mapping[str, Any] | None = None, **options: Unpack[RosOptions]) -> None:
        """Makes the node with what is given declared as it comes, so that `declare` can judge it.

        Args:
            name: of the node, unless it is remapped.
            given: parameters that are overridden.
            options: as of rclpy's node.

        Raises:
            ConfigError: a parameter was given an empty value, or one of rclpy's that is no bool.
            InputError: there can be no such node.
        """
        options.setdefault("node_name", name)
        self.first_name = options["node_name"]
        self._topics: set[str] = set()  # that it has asked for, by their full names before any rule
        options["parameter_overrides"] = [*options.get("parameter_overrides", []),
                                          *(RosParameter(key, value=value) for key, value in (given or {}).items())]
        try:
            super().__init__(automatically_declare_parameters_from_overrides=True, allow_undeclared_parameters=True,
                             **options)
        except (ValueError, RuntimeError, NameValidationException) as error:  # RuntimeError: rclpy's RCLError too, as
            # where security is asked for and cannot be had
            overrides = getattr(self, "_parameter_overrides", {})
            empty = [name for name, one in overrides.items() if one.type_ is RosParameter.Type.NOT_SET]
            if isinstance(error, ValueError) and empty:
                raise ConfigError(f"{', '.join(empty)}: is given an empty value, it must have one, or be left "
                                  "out") from error
            raise InputError(f"the node cannot be made: {_in_one_line(error)}") from error
        self.set_descriptor("use_sim_time",
                            ParameterDescriptor(type=ParameterType.PARAMETER_BOOL, description=_SIM_TIME))
        self.defaulted: dict[str, Value] = {}
        self.fixed: set[str] = set()
        self.autostart = True
        self.others: Collection[str] = ()

    @property
    def names_in_use(self) -> set[str]:
        """The full names of its topics and services so far, before any rule gives them others."""
        served = {one.srv_name for one in self.services} | {one.srv_name for one in self.clients}
        return self._topics | {self.resolve_service_name(name, only_expand=True) for name in served}

    def expanded(self, name: str) -> str:
        """The full name of a topic or service, before any rule."""
        return super().resolve_topic_name(name, only_expand=True)

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """As of rclpy."""
        if not only_expand:
            self._topics.add(self.expanded(topic))
        return super().resolve_topic_name(topic, only_expand=only_expand)

    def declare_parameters(self, namespace: str, parameters: list[Any], *args: Any, **options: Any) -> list[Any]:
        """As of rclpy, which begins with what was given and would go on with a `use_sim_time` that is no bool."""
        for name, value, *_ in parameters:
            if name in _BOOLS_OF_RCLPY and value is not None:
                checked(name, value, False, Range(""))
        return super().declare_parameters(namespace, parameters, *args, **options)

    def declare_parameter(self, name: str, *args: Any, **options: Any) -> RosParameter:
        """As of rclpy; a quality of service comes with the value in force, which may have been set after the start."""
        if name.startswith(PREFIX):
            options["ignore_override"] = True
        return super().declare_parameter(name, *args, **options)


def _in_one_line(error: Exception) -> str:
    """Without the place in the source, and without the arrow below a wrong letter."""
    return " ".join(str(error).split(", at ")[0].rstrip("^ \n").split())


def table_of(settings: type[Any]) -> dict[str, Parameter]:
    """The parameters that the fields of a settings dataclass define."""
    return {parameter.name: parameter for parameter in parameters_of(settings)}


def declare(node: DeclaringNode, table: Mapping[str, Parameter], changeable: Collection[str] = ()) -> dict[str, Value]:
    """Declares `table`, perhaps again, and returns the values in force; all but `changeable` are read-only.

    A node that is configured from outside may be given other values while it is not: there no parameter is read-only,
    but `fixed` where it is configured.

    Raises:
        ConfigError: an override has the wrong type or is out of range.
    """
    values = {name: _taken(node, parameter) for name, parameter in table.items()}
    node.fixed.update({*table}.difference(changeable))
    for name, value in values.items():
        _declare(node, name, value, describe(table[name].limits, value, name not in changeable and node.autostart))
    return values


def given(node: DeclaringNode, name: str) -> Any:
    """The value that somebody has given a parameter, unchecked; None: nobody has."""
    if not node.has_parameter(name):
        return None
    value = node.get_parameter(name).value
    return None if name in node.defaulted and node.defaulted[name] == value else value


def _taken(node: DeclaringNode, parameter: Parameter) -> Value:
    value = given(node, parameter.name)
    if value is None:
        node.defaulted[parameter.name] = parameter.default
        return parameter.default
    node.defaulted.pop(parameter.name, None)
    return checked(parameter.name, value, parameter.default, parameter.limits)


def _declare(node: Node, name: str, value: Any, shown: ParameterDescriptor) -> None:
    """A read-only one that is declared already stays as it is, as nobody can have changed it."""
    if node.has_parameter(name):
        if node.describe_parameter(name).read_only:
            return
        node.undeclare_parameter(name)
    node.declare_parameter(name, value, shown, ignore_override=True)


def declare_names(node: DeclaringNode, name: str, doc: str) -> list[str]:
    """Declares a read-only list of strings, empty by default; a single string counts as a list of one.

    Raises:
        ConfigError: the override is something else.
    """
    value = (node.get_parameter(name).value if node.has_parameter(name) else None) or []
    names = list(value) if isinstance(value, Iterable) and not isinstance(value, str) else [value]
    if not all(isinstance(one, str) for one in names):
        raise ConfigError(f"{name}: {value!r} must be a list of names, as in -p {name}:=[/a,/b]")
    shown = ParameterDescriptor(description=doc, read_only=node.autostart)
    node.fixed.add(name)
    _declare(node, name, names or RosParameter.Type.STRING_ARRAY, shown)
    return names


def topic_of(node: Node, name: str) -> str:
    """The full name of a topic.

    Raises:
        InputError: there can be no topic of this name.
    """
    try:
        return node.resolve_topic_name(name)
    except RuntimeError as error:  # rclpy's RCLError is not public
        reason = _in_one_line(error).removeprefix("failed to resolve name: ")
        raise InputError(f"{name!r} is no name of a topic, it must be as /camera/image_raw: {reason}") from error


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


def warn_of_unknown(node: DeclaringNode, known: Collection[str]) -> None:
    """Logs every override of a parameter that the node does not have, with similar names."""
    for name in node.get_parameters_by_prefix(""):
        if name in known or name in _OF_EVERY_NODE or name in node.others or name.startswith(PREFIX):
            continue
        node.get_logger().warning(unknown(name, known))


def unknown(name: str, known: Collection[str]) -> str:
    """That there is no such parameter, with similar names."""
    meant = did_you_mean(name, known)
    return f"parameter {name} is unknown and has no effect{meant and f'; {meant}'}"


class ParameterUpdates:
    """Applies changes of parameters at run time: `take` applies all of them, or raises InputError and changes none."""

    def __init__(self, node: Node, table: Mapping[str, Parameter], take: Callable[[dict[str, Value]], None]) -> None:
        self._node, self._table, self._take = node, table, take
        node.add_pre_set_parameters_callback(self._as_declared)
        node.add_on_set_parameters_callback(self._apply)

    def close(self) -> None:
        """Applies none from now on."""
        self._node.remove_pre_set_parameters_callback(self._as_declared)
        self._node.remove_on_set_parameters_callback(self._apply)

    def _as_declared(self, changed: list[RosParameter]) -> list[RosParameter]:
        """Changes in the types of their parameters.

        As integers that were given for floats, lists for text, and the bool that `ros2 param set ... off` sends.
        """
        return [self._of_its_type(one) for one in changed]

    def _of_its_type(self, one: RosParameter) -> RosParameter:
        declared = self._table.get(one.name)
        if declared is None:
            return one
        try:
            return RosParameter(one.name, value=checked(one.name, one.value, declared.default,
                                                         Range("", choices=declared.limits.choices)))
        except ConfigError:  # rclpy says what its type must be, or `_apply` what it may be
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
