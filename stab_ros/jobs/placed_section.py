"""The cross-section of a live discharge, from the parameters of its node."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Value
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.georeferencing.local_frame import LOCAL, LocalFrame
from stab_ros.georeferencing.settings import numbers_of
from stab_ros.io.section_file import Heights, SectionTable, read_section
from stab_ros.jobs.discharge_input import Line, in_map, section_of
from stab_ros.parameters.discharge import DISCHARGE_PARAMETERS
from stab_ros.parameters.table import checked_values

_HEIGHTS: Mapping[Value, Heights] = {"elevation": "elevation", "depth": "depth"}


def placed_section(given: Mapping[str, Value]) -> tuple[CrossSection, tuple[str, ...]]:
    """Reads the section, and places it in the map.

    Args:
        given: parameters of DISCHARGE_PARAMETERS by name, those that were given alone.

    Returns:
        The section with elevations of its bed, and warnings.

    Raises:
        InputError: a parameter or the file is missing or wrong.
    """
    defaults = {name: one.default for name, one in DISCHARGE_PARAMETERS.items()}
    values = {**defaults, **checked_values(given, DISCHARGE_PARAMETERS)}
    if not values["section_file"]:
        raise ConfigError("section_file: is not given, it must be the path of the cross-section, a table X,Y,Z")
    path = Path(str(values["section_file"]))
    table = read_section(path)
    line = _line(values, path, table)
    heights = _heights(values, path, table)
    if heights == "depth" and "wse_m" not in given:
        raise ConfigError(f"wse_m: is not given, but {path} has depths; it must be the elevation of the water surface "
                          "from which they were measured")
    if values["crs"] != LOCAL:
        table, line = in_map(table, line, str(values["crs"]), _origin(values))
    section, _, said = section_of(path, table, line, heights, float(values["wse_m"]))
    return section, tuple(said)


def _line(values: Mapping[str, Value], path: Path, table: SectionTable) -> Line | None:
    text = str(values["section_line"])
    if table.position_m is not None and (text.strip() or values["section_start_m"]):
        raise ConfigError(f"section_line: {path} has places of its own, section_line and section_start_m must not be "
                          "given: they are for distances along a line")
    if text.strip():
        x1, y1, x2, y2 = numbers_of("section_line", text, 4)
        return Line((x1, y1), (x2, y2), float(values["section_start_m"]))
    if table.position_m is None:
        raise ConfigError(f"section_line: is not given, but {path} has distances along a line; it must tell where the "
                          "line lies, 'X1, Y1, X2, Y2'")
    return None


def _heights(values: Mapping[str, Value], path: Path, table: SectionTable) -> Heights:
    heights = _HEIGHTS.get(values["heights"], table.heights)
    if heights == "unknown":
        raise ConfigError(f"heights: the header of {path} does not tell what its heights are, it must be elevation or "
                          "depth")
    return heights


def _origin(values: Mapping[str, Value]) -> LocalFrame:
    text = str(values["origin"])
    if not text.strip():
        raise ConfigError(f"origin: is not given, but crs is {values['crs']}; it must be that of the map, 'latitude, "
                          "longitude, height'")
    return LocalFrame(*numbers_of("origin", text, 3))
