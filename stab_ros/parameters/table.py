"""All parameters of the engines by name, for ROS nodes and for `-p name:=value` on the command line."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Range, Value, checked, did_you_mean, settings_of
from stab_ros.evaluation.settings import EvaluatorConfig
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.methods import METHODS
from stab_ros.parameters.presets import PRESETS
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.velocimetry.lspiv_settings import LspivConfig
from stab_ros.velocimetry.settings import PRESETS as VELOCITY_PRESETS
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.stiv_settings import StivConfig

Config = TypeVar("Config", StabilizerConfig, EvaluatorConfig, GeoreferenceConfig, VelocityConfig)


@dataclass(frozen=True)
class Parameter:
    """Name, default (which sets the type) and accepted values of a parameter."""

    name: str
    default: Value
    limits: Range


_REGION = 'JSON [[[x, y], ...], ...] in reference pixels, or the path of a .json file or of a PNG mask; "": none'


def parameters_of(config: type[Any], prefix: str = "") -> Iterator[Parameter]:
    """One parameter for each field of a settings dataclass."""
    for name, default, limits in settings_of(config):
        yield Parameter(prefix + name, default, limits)


def _areas() -> Iterator[Parameter]:
    yield Parameter("roi", "", Range(f"Region of static ground: {_REGION}"))
    yield Parameter("exclude", "", Range(f"Region to ignore, for example the water: {_REGION}"))


def _of_the_tracker() -> Iterator[Parameter]:
    for one in parameters_of(StabilizerConfig):
        yield _method_or_preset(one, PRESETS) if one.name == "method" else one
    yield from _areas()
    yield Parameter("static_map", "", Range("Path of a static map of the same reference: a bag written by stabilize, "
                                            'or a PNG (white: static ground); "": the map is estimated at the start'))
    yield Parameter("points_file", "", Range("Path of a CSV file name,x,y with the points to track, in reference "
                                             'pixels, for methods that take points; "": the method chooses them'))
    yield Parameter("manual_points", "", Range("Points to track as JSON [[x, y], ...] in reference pixels, in place of "
                                               "points_file"))
    yield Parameter("use_camera_info", False, Range("Whether to remove lens distortion with the calibration of "
                                                    "camera_info"))
    for name, method in METHODS.items():
        yield from parameters_of(method.Config, f"{name}.")


def _method_or_preset(method: Parameter, presets: Collection[str]) -> Parameter:
    choices = (*method.limits.choices, *presets)
    doc = f"{method.limits.doc}; a preset selects a method and sets other parameters"
    return dataclasses.replace(method, limits=dataclasses.replace(method.limits, doc=doc, choices=choices))


def _of_the_evaluator() -> Iterator[Parameter]:
    yield from parameters_of(EvaluatorConfig)
    yield from _areas()
    yield Parameter("points_file", "", Range("Path of a CSV file name,x,y with verification points in reference "
                                             'pixels; "": chosen in the reference frame'))


def _of_georeferencing() -> Iterator[Parameter]:
    yield from parameters_of(GeoreferenceConfig)
    yield Parameter("gcps_file", "", Range("Path of the ground control points, a CSV file name,x,y,X,Y,Z or GeoJSON; "
                                           '"": none'))
    yield Parameter("camera_file", "", Range("Path of a camera.yaml, as `stab-ros camera` writes it, or the name of a "
                                             'profile; "": camera_info tells the calibration'))
    yield Parameter("crs", "local", Range("Reference system of the control points and of GeoTIFFs: an EPSG code, or "
                                          "local for metres in the map; not given: that of the files"))
    yield Parameter("origin", "", Range("Origin of the map, 'latitude, longitude, height' in degrees and metres; "
                                        '"": the centre of the control points, or the first fix'))


def _of_velocimetry() -> Iterator[Parameter]:
    for one in parameters_of(VelocityConfig):
        yield _method_or_preset(one, VELOCITY_PRESETS) if one.name == "method" else one
    yield from parameters_of(LspivConfig, "lspiv.")
    yield from parameters_of(StivConfig, "stiv.")
    yield Parameter("lines", "", Range("Lines of stiv, JSON [[[x, y], [x, y]], ...] in metres in the map (pixels of "
                                       "the reference without georeference), or the path of a .json file"))
    yield Parameter("roi", "", Range(f"Region in which velocities are wanted: {_REGION}"))
    yield Parameter("exclude", "", Range(f"Region to leave out: {_REGION}"))
    yield Parameter("static_map", "", Range("Path of a static map of the same reference: a bag written by stabilize, "
                                            "or a PNG (white: static ground). Its ground is left out, and the velocity "
                                            'there, which must be 0, is told beside; "": that of the tracker'))
    yield Parameter("leave_out_bank", True, Range("Whether the ground of the tracker's static map is left out; false: "
                                                  "only that of the parameter static_map"))
    yield Parameter("grid_m", 0.0, Range("Side of the cells of velocity_grid in metres (pixels without georeference); "
                                         "0: what suits the first vectors", 0.0, 10000.0))
    yield Parameter("orthophotos", False, Range("Whether velocities are measured in orthophotos; false: in the images "
                                                "as they come, and their vectors are scaled"))


Table = Mapping[str, Parameter]
PARAMETERS: Table = {parameter.name: parameter for parameter in _of_the_tracker()}
EVALUATOR_PARAMETERS: Table = {parameter.name: parameter for parameter in _of_the_evaluator()}

GEOREFERENCE_PARAMETERS: Table = {parameter.name: parameter for parameter in _of_georeferencing()}
OWN_VELOCITY_PARAMETERS: Table = {parameter.name: parameter for parameter in _of_velocimetry()}
VELOCITY_PARAMETERS: Table = {**OWN_VELOCITY_PARAMETERS, **GEOREFERENCE_PARAMETERS}


def checked_values(values: Mapping[str, object], table: Table = PARAMETERS) -> dict[str, Value]:
    """`values` converted to the types of `table`.

    Raises:
        ConfigError: an unknown name, a wrong type, or out of range.
    """
    return {name: _checked(name, value, table) for name, value in values.items()}


def _checked(name: str, value: object, table: Table) -> Value:
    parameter = table.get(name)
    if parameter is None:
        meant = did_you_mean(name, table) or f"it must be one of {', '.join(sorted(table))}"
        raise ConfigError(f"parameter {name!r} is unknown, {meant}")
    return checked(name, value, parameter.default, parameter.limits)


def resolved(values: Mapping[str, Value]) -> dict[str, Value]:
    """`values` over those of the preset that `method` names, and with the method of the preset."""
    preset = PRESETS.get(str(values.get("method", "")))
    return dict(values) if preset is None else {**preset, **values, "method": preset["method"]}


def table_with_preset(method: object) -> Table:
    """PARAMETERS with the defaults of the preset `method`; unchanged for any other name."""
    if not isinstance(method, str) or method not in PRESETS:
        return PARAMETERS
    return _with_defaults(PARAMETERS, {**PRESETS[method], "method": method})


def velocity_table_with_preset(method: object) -> Table:
    """VELOCITY_PARAMETERS with the defaults of the preset `method`; unchanged for any other name."""
    if not isinstance(method, str) or method not in VELOCITY_PRESETS:
        return VELOCITY_PARAMETERS
    return _with_defaults(VELOCITY_PARAMETERS, {**VELOCITY_PRESETS[method], "method": method})


def _with_defaults(table: Table, values: Mapping[str, Value]) -> Table:
    defaults = checked_values(values, table)
    return {name: dataclasses.replace(one, default=defaults.get(name, one.default)) for name, one in table.items()}


def check_change(old: Mapping[str, Value], changed: Mapping[str, Value]) -> None:
    """Raises ConfigError for a change of preset: a preset sets defaults, which a running engine has already."""
    method = changed.get("method")
    if method in PRESETS and method != old.get("method"):
        raise ConfigError(f"method: the preset {method} can only be chosen at the start; "
                          f"set method to {PRESETS[str(method)]['method']} and its parameters one by one")


def stabilizer_config(values: Mapping[str, Value]) -> StabilizerConfig:
    """The settings of the stabilizer: defaults, overridden by a preset, overridden by `values`.

    Raises:
        ConfigError: as `checked_values`.
    """
    values = checked_values(resolved(values))
    config = _config(StabilizerConfig, values)
    prefix = f"{config.method}."
    of_method: Any = {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}
    return dataclasses.replace(config, method_config=METHODS[config.method].Config(**of_method))


def evaluator_config(values: Mapping[str, Value]) -> EvaluatorConfig:
    """The settings of the evaluator: defaults, overridden by `values`.

    Raises:
        ConfigError: as `checked_values`, or settings that contradict each other.
    """
    return _config(EvaluatorConfig, checked_values(values, EVALUATOR_PARAMETERS))


def georeference_config(values: Mapping[str, Value]) -> GeoreferenceConfig:
    """The settings of georeferencing: defaults, overridden by `values`.

    Raises:
        ConfigError: as `checked_values`, or settings that contradict each other.
    """
    return _config(GeoreferenceConfig, checked_values(values, GEOREFERENCE_PARAMETERS))


def velocity_config(values: Mapping[str, Value]) -> VelocityConfig:
    """The settings of velocimetry: defaults, overridden by a preset, overridden by `values`.

    Raises:
        ConfigError: as `checked_values`, or settings that contradict each other.
    """
    preset = VELOCITY_PRESETS.get(str(values.get("method", "")))
    if preset is not None:
        values = {**preset, **values, "method": preset["method"]}
    return _config(VelocityConfig, checked_values(values, VELOCITY_PARAMETERS))


def lspiv_config(values: Mapping[str, Value]) -> LspivConfig:
    """The settings of `lspiv` among parameters of velocimetry.

    Raises:
        ConfigError: as `checked_values`, or settings that contradict each other.
    """
    return LspivConfig(**_below("lspiv.", values))


def stiv_config(values: Mapping[str, Value]) -> StivConfig:
    """The settings of `stiv` among parameters of velocimetry.

    Raises:
        ConfigError: as `checked_values`.
    """
    return StivConfig(**_below("stiv.", values))


def _below(prefix: str, values: Mapping[str, Value]) -> dict[str, Any]:
    return {name.removeprefix(prefix): value for name, value in checked_values(values, VELOCITY_PARAMETERS).items()
            if name.startswith(prefix)}


def _config(settings: type[Config], values: Mapping[str, Value]) -> Config:
    """Settings of the values that have a field in them."""
    own = {item.name for item in dataclasses.fields(settings)}
    chosen: Any = {name: value for name, value in values.items() if name in own}
    return settings(**chosen)
