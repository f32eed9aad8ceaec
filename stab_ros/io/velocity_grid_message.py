"""The velocities of an interval on a grid, as a PointCloud2 in the map: a point for every cell that holds vectors.

vx, vy: medians. count: number of vectors. standard_error: of the median, by all errors, root of the trace of its
covariance var_vx, cov_vxvy, var_vy.
"""

from __future__ import annotations

import numpy as np

from stab_ros.io.cdr import Header
from stab_ros.io.point_cloud import cloud_cdr
from stab_ros.velocimetry.grid import VelocityGrid

_FIELDS = [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("vx", "<f8"), ("vy", "<f8"), ("count", "<u4"),
           ("standard_error", "<f8"), ("var_vx", "<f8"), ("var_vy", "<f8"), ("cov_vxvy", "<f8")]


def velocity_grid_cdr(grid: VelocityGrid, wse_m: float, header: Header) -> bytes:
    """The message of a grid. wse_m: water surface elevation in the map."""
    table, sigma = np.zeros(len(grid.count), _FIELDS), grid.sigma_m_s
    (table["x"], table["y"]), (table["vx"], table["vy"]) = grid.centre_m.T, grid.median_m_s.T
    table["z"], table["count"], table["standard_error"] = wse_m, grid.count, np.hypot(*sigma.T)
    table["var_vx"], table["var_vy"] = (sigma**2).T
    table["cov_vxvy"] = np.sum(grid.shared[:, 0] * grid.shared[:, 1], axis=1)
    return cloud_cdr(table, header)
