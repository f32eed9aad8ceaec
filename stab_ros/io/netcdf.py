"""What our NetCDF files have in common: classic format with 64-bit offsets, CF conventions 1.8.

NetCDF's classic format has no 64-bit integers: times are seconds since the first stamp, which the attribute
`first_stamp_ns` holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from stab_ros.core.errors import WorkError
from stab_ros.core.types import FloatArray
from stab_ros.core.version import __version__
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.velocimetry.vectors import Unit


@dataclass(frozen=True, eq=False)
class Variable:
    """dimensions: their names. data: an array of them. attributes: by name, text or a number of the type of data."""

    dimensions: tuple[str, ...]
    data: Any
    attributes: Mapping[str, Any]


def write_variables(path: Path, about: Mapping[str, str], sizes: Mapping[str, int],
                    variables: Mapping[str, Variable]) -> None:
    """Writes a file.

    Args:
        path: an existing one is overwritten.
        about: global attributes, beside conventions and source.
        sizes: length of each dimension.
        variables: by name.

    Raises:
        WorkError: the file cannot be written.
    """
    try:
        with netcdf_file(path, "w", version=2) as file:
            for name, text in {"Conventions": "CF-1.8", "source": f"stab_ros {__version__}", **about}.items():
                setattr(file, name, text)
            for name, size in sizes.items():
                file.createDimension(name, size)
            for name, variable in variables.items():
                _add(file, name, variable)
    except OSError as error:
        raise WorkError(f"{path}: {error.strerror}") from error


def _add(file: Any, name: str, variable: Variable) -> None:
    data = np.asarray(variable.data)
    made = file.createVariable(name, data.dtype, variable.dimensions)
    if data.size:
        made[:] = data
    for key, value in variable.attributes.items():
        setattr(made, key, value)


def places_attributes(unit: Unit) -> tuple[dict[str, str], dict[str, str]]:
    """Attributes of x and of y."""
    if unit == "px":
        return ({"long_name": "x in the reference, to the right", "units": "1"},
                {"long_name": "y in the reference, down", "units": "1"})
    return ({"standard_name": "projection_x_coordinate", "long_name": "east in the map", "units": "m", "axis": "X"},
            {"standard_name": "projection_y_coordinate", "long_name": "north in the map", "units": "m", "axis": "Y"})


def units_of(unit: Unit) -> tuple[str, str]:
    """Of velocities, and of their squares."""
    return ("m s-1", "m2 s-2") if unit == "m" else ("s-1", "s-2")


def origin_of(local_frame: LocalFrame | None) -> dict[str, Any]:
    """Global attributes that tell where the map is on the Earth."""
    if local_frame is None:
        return {}
    return {"origin_latitude_deg": local_frame.latitude_deg, "origin_longitude_deg": local_frame.longitude_deg,
            "origin_height_m": local_frame.height_m}


def since(first_ns: int) -> dict[str, str]:
    """Attributes of times in seconds since this stamp."""
    return {"units": f"seconds since {datetime.fromtimestamp(first_ns // 10**9, timezone.utc):%Y-%m-%d %H:%M:%S}."
                     f"{first_ns % 10**9:09d}", "calendar": "standard"}


def geodetic(local_frame: LocalFrame, x: FloatArray, y: FloatArray, up_m: float, dimensions: tuple[str, ...]
             ) -> dict[str, Variable]:
    """Latitudes and longitudes of places in the map: x, y of one shape, m."""
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, up_m)])
    found = local_frame.to_geodetic(places) if x.size else np.zeros((0, 3))
    return {"lat": Variable(dimensions, found[:, 0].reshape(x.shape), {
                "standard_name": "latitude", "units": "degrees_north"}),
            "lon": Variable(dimensions, found[:, 1].reshape(x.shape), {
                "standard_name": "longitude", "units": "degrees_east"})}
