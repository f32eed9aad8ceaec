"""Uncertainty by the tables of ISO 748 (velocity-area methods).

u(Q)^2 = u_m^2 + u_s^2 + sum q_i^2 (u_b^2 + u_d^2 + u_p^2 + u_v^2) / (sum q_i)^2, all relative standard deviations. The
numbers are those of ISO 748:2007, annex E, for a current meter near the surface, in the reading of USGS IVyTools.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray

_VERTICALS = (5, 10, 15, 20, 25, 30, 35)
_BY_VERTICALS = (0.075, 0.045, 0.030, 0.025, 0.020, 0.015, 0.010)  # table E.6


def sigma_by_number(verticals: int) -> float:
    """u_m, the relative standard deviation of a discharge by so many verticals (table E.6)."""
    return float(np.interp(verticals, _VERTICALS, _BY_VERTICALS))


@dataclass(frozen=True)
class Iso748:
    """Relative standard deviations of one vertical.

    Attributes:
        width: u_b, of its width.
        depth: u_d, of a depth above `shallow_m`.
        shallow_depth: u_d, of a smaller depth.
        points: u_p, as the velocity is measured in one point of the vertical.
        exposure: u_v, as it is measured for a limited time.
        shallow_m: limit of shallow water.
    """

    width: float = 0.005
    depth: float = 0.005
    shallow_depth: float = 0.015
    points: float = 0.07
    exposure: float = 0.08
    shallow_m: float = 0.3

    def relative_sigma(self, depth_m: FloatArray, part_m3_s: FloatArray, measured: int, systematic: float) -> float:
        """Standard deviation of the discharge over the discharge.

        Args:
            depth_m: (N,), of the wet verticals.
            part_m3_s: (N,), partial discharges.
            measured: number of verticals with vectors.
            systematic: u_s, relative standard deviation by what all verticals share.
        """
        of_depth = np.where(depth_m > self.shallow_m, self.depth, self.shallow_depth)
        single = self.width**2 + of_depth**2 + self.points**2 + self.exposure**2
        total = part_m3_s.sum()
        random = float((part_m3_s**2 * single).sum() / total**2) if total else float("nan")
        return float(np.sqrt(sigma_by_number(measured) ** 2 + systematic**2 + random))
