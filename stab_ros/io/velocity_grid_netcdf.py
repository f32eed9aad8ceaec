"""Velocities on a grid over time as NetCDF (G.nc): CF conventions 1.8, dimensions time, y and x.

It is a file beside that of the vectors, since CF conventions allow one kind of features a file (section 9.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.core.types import FloatArray, IdArray
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.netcdf import Variable, geodetic, origin_of, places_attributes, since, units_of, write_variables
from stab_ros.velocimetry.grid import VelocityGrid
from stab_ros.velocimetry.vectors import Unit

_MOST_CELLS = 20_000_000  # of all times, 1 GB
_CUBE = ("time", "y", "x")


@dataclass(frozen=True, eq=False)
class TimedGrid:
    """The velocities of an interval. stamp_ns: of its last frame. wse_m: water surface elevation there."""

    stamp_ns: int
    wse_m: float
    grid: VelocityGrid


def write_grid_netcdf(path: Path, grids: Sequence[TimedGrid], unit: Unit, local_frame: LocalFrame | None = None
                      ) -> None:
    """Writes the grids of a recording, as `velocity_grid` has them.

    Args:
        path: the file; an existing one is overwritten.
        grids: in the order of their stamps; those with cells have one side.
        unit: of lengths.
        local_frame: where the map is on the Earth; None: unknown.

    Raises:
        WorkError: the file cannot be written, or would be huge.
    """
    cells = [one.grid.cell for one in grids if len(one.grid.cell)]
    low, high = _borders(cells)
    columns, rows = (high - low).tolist()
    if len(grids) * rows * columns > _MOST_CELLS:
        raise WorkError(f"{path}: {len(grids)} grids of {columns} x {rows} cells exceed {_MOST_CELLS}; grid_m must be "
                        "larger")
    first_ns = grids[0].stamp_ns if grids else 0
    beside = _beside(grids, low, (rows, columns), unit, local_frame if unit == "m" else None)
    coordinates = " ".join(name for name in beside if name not in _CUBE)
    variables = {**beside, **_cubes(grids, low, (rows, columns), unit, coordinates)}
    about = {"title": "Surface velocities of water from video, on a grid", "first_stamp_ns": str(first_ns),
             **origin_of(local_frame)}
    write_variables(path, about, {"time": len(grids), "y": rows, "x": columns}, variables)


def _beside(grids: Sequence[TimedGrid], low: IdArray, shape: tuple[int, int], unit: Unit,
            local_frame: LocalFrame | None) -> dict[str, Variable]:
    """Where and when: axes, times, and where it is known the place on the Earth."""
    side_m = next((one.grid.side_m for one in grids if len(one.grid.cell)), 1.0)
    x, y = ((low[axis] + np.arange(size) + 0.5) * side_m for axis, size in enumerate(reversed(shape)))
    beside = {**_axes(x, y, unit), **_times(grids, grids[0].stamp_ns if grids else 0, unit)}
    if local_frame is None:
        return beside
    columns_m, rows_m = np.meshgrid(x, y)
    return beside | geodetic(local_frame, columns_m, rows_m, grids[0].wse_m if grids else 0.0, ("y", "x"))


def _borders(cells: Sequence[IdArray]) -> tuple[IdArray, IdArray]:
    """First column and row, and those after the last; one cell where there are none."""
    if not cells:
        return np.zeros(2, np.int64), np.ones(2, np.int64)
    every = np.concatenate(cells)
    return every.min(axis=0), every.max(axis=0) + 1


def _axes(x: FloatArray, y: FloatArray, unit: Unit) -> dict[str, Variable]:
    of_x, of_y = places_attributes(unit)
    return {"x": Variable(("x",), x, of_x), "y": Variable(("y",), y, of_y)}


def _times(grids: Sequence[TimedGrid], first_ns: int, unit: Unit) -> dict[str, Variable]:
    """Stamps, and in the map the elevation of the water at each."""
    seconds = np.array([(one.stamp_ns - first_ns) / 1e9 for one in grids])
    time = Variable(("time",), seconds, {"standard_name": "time", "long_name": "end of the interval", "axis": "T",
                                         **since(first_ns)})
    if unit == "px":
        return {"time": time}
    return {"time": time, "z": Variable(("time",), np.array([one.wse_m for one in grids]), {
        "long_name": "water surface elevation in the map", "units": "m", "positive": "up"})}


def _cubes(grids: Sequence[TimedGrid], low: IdArray, shape: tuple[int, int], unit: Unit, coordinates: str
           ) -> dict[str, Variable]:
    """Variables of time, y and x; NaN, and a count of 0, where there are no vectors."""
    once, square = units_of(unit)
    named = (("vx", "median velocity of the water surface along x", once),
             ("vy", "median velocity of the water surface along y", once),
             ("standard_error", "standard error of the median, by all errors", once),
             ("var_vx", "variance of vx, by all errors", square), ("var_vy", "variance of vy, by all errors", square),
             ("cov_vxvy", "covariance of vx and vy, by the errors that all vectors share", square))
    values = np.full((len(named), len(grids), *shape), np.nan)
    count = np.zeros((len(grids), *shape), np.int32)
    for number, one in enumerate(grids):
        at = one.grid.cell - low
        values[:, number, at[:, 1], at[:, 0]] = _figures(one.grid)
        count[number, at[:, 1], at[:, 0]] = one.grid.count
    beside = {"vx": "var_vx count", "vy": "var_vy count"}
    where = {"coordinates": coordinates} if coordinates else {}
    made = {name: Variable(_CUBE, values[k], {**_attributes(text, units, beside.get(name)), **where})
            for k, (name, text, units) in enumerate(named)}
    return {**made, "count": Variable(_CUBE, count, {"long_name": "number of vectors", "units": "1", **where})}


def _attributes(text: str, units: str, beside: str | None) -> Mapping[str, Any]:
    more = {} if beside is None else {"ancillary_variables": beside, "cell_methods": "time: x: y: median"}
    return {"long_name": text, "units": units, "_FillValue": np.float64(np.nan), **more}


def _figures(grid: VelocityGrid) -> FloatArray:
    """(6, n), in the order of the variables."""
    sigma = grid.sigma_m_s
    return np.stack([*grid.median_m_s.T, np.hypot(*sigma.T), *(sigma**2).T,
                     np.sum(grid.shared[:, 0] * grid.shared[:, 1], axis=1)])
