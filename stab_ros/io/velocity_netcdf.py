"""Velocity vectors as NetCDF (V.nc): CF conventions 1.8, discrete sampling geometry `point`; see `netcdf`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.netcdf import Variable, geodetic, origin_of, places_attributes, since, units_of, write_variables
from stab_ros.velocimetry.speeds import sigma_speed_m_s, speed_m_s
from stab_ros.velocimetry.vectors import Vectors

_OBS, _ERRORS = "obs", "shared_error"


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
    about = {"featureType": "point", "title": "Surface velocities of water from video", "first_stamp_ns": str(first_ns),
             **origin_of(local_frame)}
    errors = {_ERRORS: vectors.shared.shape[2]} if vectors.shared.shape[2] else {}  # a length of 0 makes it unlimited
    write_variables(path, about, {_OBS: len(vectors), **errors}, variables)


def _places(vectors: Vectors, wse_m: float, local_frame: LocalFrame | None) -> dict[str, Variable]:
    x, y = vectors.position_m.T
    of_x, of_y = places_attributes(vectors.unit)
    places = {"x": _real(x, **of_x), "y": _real(y, **of_y)}
    if vectors.unit == "px":
        return places
    places["z"] = _real(np.full(len(x), wse_m), long_name="water surface elevation in the map", units="m",
                        positive="up", axis="Z")
    if local_frame is None:
        return places
    return {**places, **geodetic(local_frame, x, y, wse_m, (_OBS,))}


def _times(vectors: Vectors, first_ns: int) -> dict[str, Variable]:
    start_s, end_s = ((stamps - first_ns) / 1e9 for stamps in (vectors.start_ns, vectors.end_ns))
    about = since(first_ns)
    return {
        "time": _real((start_s + end_s) / 2, standard_name="time", long_name="midway", axis="T", **about),
        "time_start": _real(start_s, long_name="stamp of the first frame", **about),
        "time_end": _real(end_s, long_name="stamp of the last frame", **about),
    }


def _velocities(vectors: Vectors, local_frame: LocalFrame | None) -> dict[str, Variable]:
    (vx, vy), own, (unit, square) = vectors.velocity_m_s.T, vectors.covariance, units_of(vectors.unit)
    where = {"coordinates": _coordinates(vectors, local_frame)}
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


def _shared(vectors: Vectors) -> dict[str, Variable]:
    if not vectors.shared.shape[2]:
        return {}
    about = {"units": units_of(vectors.unit)[0],
             "long_name": "change by one standard deviation of each error that all vectors share"}
    return {f"shared_{v}": Variable((_OBS, _ERRORS), vectors.shared[:, axis], about)
            for axis, v in enumerate(("vx", "vy"))}


def _coordinates(vectors: Vectors, local_frame: LocalFrame | None) -> str:
    if vectors.unit == "px":
        return "time x y"
    return "time x y z" if local_frame is None else "time x y z lat lon"


def _real(data: FloatArray, **attributes: str) -> Variable:
    return Variable((_OBS,), np.asarray(data, np.float64), attributes)
