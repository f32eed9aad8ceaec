"""The parameters of a live discharge, and its settings made from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from stab_ros.core.settings import Range, Value, settings_of
from stab_ros.discharge.settings import DischargeConfig, RunningConfig
from stab_ros.parameters.table import Parameter, Table, checked_values, parameters_of

_Config = TypeVar("_Config", DischargeConfig, RunningConfig)


def _of_discharge() -> Iterator[Parameter]:
    yield Parameter("section_file", "", Range("Path of the cross-section, a table X,Y,Z or X,Y,depth or chainage,Z or "
                                              "chainage,depth; it must be given"))
    yield Parameter("section_line", "", Range("Where a section by chainage lies, 'X1, Y1, X2, Y2': its start, and "
                                              "another place in its line; \"\": the table has places"))
    yield Parameter("section_start_m", 0.0, Range("Chainage in metres at the start of section_line", -1e5, 1e5))
    yield Parameter("heights", "auto", Range("What the heights of the section are: elevation of the bed, depth below "
                                             "wse_m, or auto for what the header of the table says",
                                             choices=("auto", "elevation", "depth")))
    yield Parameter("crs", "local", Range("Reference system of the places of the section: an EPSG code, or local for "
                                          "metres in the map"))
    yield Parameter("origin", "", Range("Origin of the map for crs, 'latitude, longitude, height' in degrees and "
                                        'metres; "": unknown'))
    yield Parameter("wse_m", 0.0, Range("Water surface elevation in metres in the heights of the section, until "
                                        "water_level tells another, and from which depths count; not given: there is "
                                        "no discharge before a level comes", -500.0, 9000.0))
    yield from parameters_of(RunningConfig)
    yield from parameters_of(DischargeConfig)


DISCHARGE_PARAMETERS: Table = {parameter.name: parameter for parameter in _of_discharge()}


def discharge_config(values: Mapping[str, Value]) -> DischargeConfig:
    """How a discharge is measured: defaults, overridden by `values`.

    Raises:
        ConfigError: an unknown name, a wrong type, or out of range.
    """
    return _config(DischargeConfig, values)


def running_config(values: Mapping[str, Value]) -> RunningConfig:
    """When a discharge is measured: defaults, overridden by `values`.

    Raises:
        ConfigError: as `discharge_config`, or settings that contradict each other.
    """
    return _config(RunningConfig, values)


def _config(settings: type[_Config], values: Mapping[str, Value]) -> _Config:
    own = {name for name, _, _ in settings_of(settings)}
    chosen: Any = {name: value for name, value in checked_values(values, DISCHARGE_PARAMETERS).items() if name in own}
    return settings(**chosen)
