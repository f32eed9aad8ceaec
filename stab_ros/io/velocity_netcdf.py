"""Velocity vectors as NetCDF (V.nc): CF conventions 1.8, discrete sampling geometry `point`; classic format.

NetCDF's classic format has no 64-bit integers: times are seconds since the first stamp, which the attribute
`first_stamp_ns` holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from stab_ros.core.errors import WorkError
from stab_ros.core.types import FloatArray
from stab_ros.core.version import __version__
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.velocimetry.speeds import sigma_speed_m_s, speed_m_s
from stab_ros.velocimetry.vectors import Vectors

_OBS, _ERRORS = "obs", "shared_error"


@dataclass(frozen=True, eq=False)
class _Variable:
    dimensions: tuple[str, ...]
    data: Any
    attributes: Mapping[str, str]


def write_netcdf(path: Path, vectors: Vectors, wse_m: float = 0.0, local_frame: LocalFrame | None = None) -> None:
    """Writes the vectors, midway between start and end, with their covariance.

    Args:
        path: the file; an existing one is overwritten.
        vectors: in metres of the map, or pixels.
        wse_m: water surface elevation in the map.
        local_frame: where the map is on the Earth; None: unknown.

    Raises:
        WorkError: the file cannot be written.
    """
    first_ns = int(vectors.start_ns.min()) if len(vectors) else 0
    variables = {**_places(vectors, wse_m, local_frame), **_times(vectors, first_ns),
                 **_velocities(vectors, local_frame), **_shared(vectors)}
    try:
        with netcdf_file(path, "w", version=2) as file:
            _describe(file, first_ns, local_frame)
            file.createDimension(_OBS, len(vectors))
            if vectors.shared.shape[2]:  # a length of 0 would make it unlimited
                file.createDimension(_ERRORS, vectors.shared.shape[2])
            for name, variable in variables.items():
                _add(file, name, variable)
    except OSError as error:
        raise WorkError(f"{path}: {error.strerror}") from error


def _describe(file: Any, first_ns: int, local_frame: LocalFrame | None) -> None:
    file.Conventions, file.featureType = "CF-1.8", "point"
    file.title, file.source = "Surface velocities of water from video", f"stab_ros {__version__}"
    file.first_stamp_ns = str(first_ns)
    if local_frame is not None:
        file.origin_latitude_deg, file.origin_longitude_deg = local_frame.latitude_deg, local_frame.longitude_deg
        file.origin_height_m = local_frame.height_m


def _add(file: Any, name: str, variable: _Variable) -> None:
    data = np.asarray(variable.data)
    made = file.createVariable(name, data.dtype, variable.dimensions)
    if data.size:
        made[:] = data
    for key, text in variable.attributes.items():
        setattr(made, key, text)


def _places(vectors: Vectors, wse_m: float, local_frame: LocalFrame | None) -> dict[str, _Variable]:
    x, y = vectors.position_m.T
    if vectors.unit == "px":
        return {"x": _real(x, long_name="x in the reference, to the right", units="1"),
                "y": _real(y, long_name="y in the reference, down", units="1")}
    places = {
        "x": _real(x, standard_name="projection_x_coordinate", long_name="east in the map", units="m", axis="X"),
        "y": _real(y, standard_name="projection_y_coordinate", long_name="north in the map", units="m", axis="Y"),
        "z": _real(np.full(len(x), wse_m), long_name="water surface elevation in the map", units="m", positive="up",
                   axis="Z"),
    }
    if local_frame is None:
        return places
    geodetic = local_frame.to_geodetic(np.column_stack([x, y, np.full(len(x), wse_m)])) if len(x) else np.zeros((0, 3))
    return {**places, "lat": _real(geodetic[:, 0], standard_name="latitude", units="degrees_north"),
            "lon": _real(geodetic[:, 1], standard_name="longitude", units="degrees_east")}


def _times(vectors: Vectors, first_ns: int) -> dict[str, _Variable]:
    since = f"seconds since {datetime.fromtimestamp(first_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S}.{first_ns % 10**9:09d}"
    start_s, end_s = ((stamps - first_ns) / 1e9 for stamps in (vectors.start_ns, vectors.end_ns))
    about = {"units": since, "calendar": "standard"}
    return {
        "time": _real((start_s + end_s) / 2, standard_name="time", long_name="midway", axis="T", **about),
        "time_start": _real(start_s, long_name="stamp of the first frame", **about),
        "time_end": _real(end_s, long_name="stamp of the last frame", **about),
    }


def _velocities(vectors: Vectors, local_frame: LocalFrame | None) -> dict[str, _Variable]:
    (vx, vy), own, unit = vectors.velocity_m_s.T, vectors.covariance, "m s-1" if vectors.unit == "m" else "s-1"
    square, where = ("m2 s-2" if vectors.unit == "m" else "s-2"), {"coordinates": _coordinates(vectors, local_frame)}
    return {
        "vx": _real(vx, long_name="velocity of the water surface along x", units=unit, ancillary_variables="var_vx",
                    **where),
        "vy": _real(vy, long_name="velocity of the water surface along y", units=unit, ancillary_variables="var_vy",
                    **where),
        "speed": _real(speed_m_s(vectors), long_name="speed of the water surface", units=unit,
                       ancillary_variables="sigma_speed", **where),
        "sigma_speed": _real(sigma_speed_m_s(vectors), units=unit,
                             long_name="standard deviation of speed, by own and shared errors", **where),
        "var_vx": _real(own[:, 0, 0], long_name="variance of vx by its own error", units=square, **where),
        "var_vy": _real(own[:, 1, 1], long_name="variance of vy by its own error", units=square, **where),
        "cov_vxvy": _real(own[:, 0, 1], long_name="covariance of vx and vy by their own errors", units=square, **where),
        "track_id": _real(vectors.track_id.astype(float), long_name="number of the trajectory", units="1"),
    }


def _shared(vectors: Vectors) -> dict[str, _Variable]:
    if not vectors.shared.shape[2]:
        return {}
    about = {"units": "m s-1" if vectors.unit == "m" else "s-1",
             "long_name": "change by one standard deviation of each error that all vectors share"}
    return {f"shared_{v}": _Variable((_OBS, _ERRORS), vectors.shared[:, axis], about)
            for axis, v in enumerate(("vx", "vy"))}


def _coordinates(vectors: Vectors, local_frame: LocalFrame | None) -> str:
    if vectors.unit == "px":
        return "time x y"
    return "time x y z" if local_frame is None else "time x y z lat lon"


def _real(data: FloatArray, **attributes: str) -> _Variable:
    return _Variable((_OBS,), np.asarray(data, np.float64), attributes)
