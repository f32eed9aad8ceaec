"""The velocities of an interval as a PointCloud2 in the map, in double precision.

x and y are where a vector begins, z is the water surface; `scale_wse` is the water surface elevation whose scale they
have, NaN where the scale is given for the picture; `end_offset_s` is the time of its end less the stamp of the header.
`var_vx`, `cov_vxvy` and `var_vy` are of its own error, `shared_vx_0`, `shared_vy_0`, ... its changes by one standard
deviation of each error that all vectors share, as in `V.csv`. Without georeference x and y are pixels of the reference
and velocities px/s.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import SECOND_NS, Header
from stab_ros.io.point_cloud import Table, cloud_cdr, read_cloud
from stab_ros.velocimetry.vectors import Unit, Vectors

_REAL = ("x", "y", "z", "vx", "vy", "var_vx", "var_vy", "cov_vxvy", "dt", "end_offset_s")
_SCALE = "scale_wse"  # older recordings lack it
_ID = "track_id"  # modulo 2^32: no field of a cloud has more bits


def velocity_cdr(vectors: Vectors, wse_m: float, header: Header, scale_wse_m: float | None = None) -> bytes:
    """The message of the vectors.

    Args:
        vectors: in the map, or in pixels.
        wse_m: water surface elevation in the map.
        header: stamp and frame.
        scale_wse_m: that whose scale the vectors have; NaN: that of none. None: `wse_m`.
    """
    shared = [f"shared_{v}_{k}" for k in range(vectors.shared.shape[2]) for v in ("vx", "vy")]
    real = [(name, "<f8") for name in (*_REAL, _SCALE)]
    table = np.zeros(len(vectors), [*real, (_ID, "<u4"), *((s, "<f8") for s in shared)])
    (table["x"], table["y"]), (table["vx"], table["vy"]) = vectors.start_m.T, vectors.velocity_m_s.T
    own = vectors.covariance
    table["z"], table["dt"], table[_SCALE] = wse_m, vectors.dt_s, wse_m if scale_wse_m is None else scale_wse_m
    table["var_vx"], table["var_vy"], table["cov_vxvy"] = own[:, 0, 0], own[:, 1, 1], own[:, 0, 1]
    table["end_offset_s"] = (vectors.end_ns - header.stamp_ns) / SECOND_NS
    table[_ID] = vectors.track_id % 2**32
    for name, values in zip(shared, vectors.shared.transpose(2, 1, 0).reshape(len(shared), -1), strict=True):
        table[name] = values
    return cloud_cdr(table, header)


def read_velocity(cdr: bytes | memoryview, unit: Unit = "m") -> tuple[Header, Vectors]:
    """Header and vectors of a message; stamps come back exactly, places and velocities to their last digits.

    Raises:
        MessageError: damaged, or a cloud of something else.
    """
    header, table = read_cloud(cdr)
    missing = [name for name in (*_REAL, _ID) if name not in (table.dtype.names or ())]
    if missing:
        raise MessageError(f"a PointCloud2 without the field {missing[0]}, it must be a velocity of velocimetry_node")
    try:
        return header, _vectors(table, header.stamp_ns, unit)
    except ValueError as error:
        raise MessageError(f"a PointCloud2 of velocities that cannot be: {error}") from error


def read_surface(cdr: bytes | memoryview) -> float | None:
    """The water surface elevation whose scale the vectors of a message have; None without vectors, or for none.

    A message without `scale_wse` has that of z; a z of 0 there may be one that nobody told, so it tells nothing.

    Raises:
        MessageError: damaged, or a cloud of something else.
    """
    _, table = read_cloud(cdr)
    names = table.dtype.names or ()
    if "z" not in names:
        raise MessageError("a PointCloud2 without the field z, it must be a velocity of velocimetry_node")
    heights = table[_SCALE] if _SCALE in names else table["z"][table["z"] != 0]
    heights = heights[np.isfinite(heights)]
    return float(np.median(heights)) if len(heights) else None


def _vectors(table: Table, stamp_ns: int, unit: Unit) -> Vectors:
    common = sum(name.startswith("shared_vx_") for name in table.dtype.names or ())
    end_ns = stamp_ns + np.round(table["end_offset_s"] * SECOND_NS).astype(np.int64)
    start_ns = end_ns - np.round(table["dt"] * SECOND_NS).astype(np.int64)
    start, v = np.column_stack([table["x"], table["y"]]), np.column_stack([table["vx"], table["vy"]])
    own = np.column_stack([table[name] for name in ("var_vx", "cov_vxvy", "cov_vxvy", "var_vy")]).reshape(-1, 2, 2)
    shared = np.zeros((len(table), 2, common))
    for k in range(common):
        shared[:, 0, k], shared[:, 1, k] = table[f"shared_vx_{k}"], table[f"shared_vy_{k}"]
    if not (np.isfinite(start).all() and np.isfinite(v).all() and np.isfinite(own).all() and np.isfinite(shared).all()):
        raise ValueError("a number is not finite")
    end = start + v * ((end_ns - start_ns) * 1e-9)[:, None]
    return Vectors(start, end, start_ns, end_ns, own, shared, table[_ID].astype(np.int64), unit)
