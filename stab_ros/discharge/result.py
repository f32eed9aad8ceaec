"""What a discharge measurement says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stab_ros.core.types import BoolArray, FloatArray, IdArray


@dataclass(frozen=True, eq=False)
class Verticals:
    """N verticals, also those above the water.

    Attributes:
        position_m: (N, 2), east and north in the map.
        chainage_m: (N,).
        bed_m: (N,), elevation of the bed.
        depth_m: (N,), negative above the water.
        channel: (N,), which channel each lies in, -1 above the water.
        surface_m_s: (N,), velocity across the section, downstream; filled where it is not measured, 0 above the water.
        along_m_s: (N,), component along the section; NaN where it is not measured.
        sigma_m_s: (N,), standard deviation of the surface velocity by all errors of the vectors; NaN where filled.
        count: (N,), vectors within the search distance.
        measured: (N,), whether there were enough.
        part_m3_s: (N,), partial discharges.
    """

    position_m: FloatArray
    chainage_m: FloatArray
    bed_m: FloatArray
    depth_m: FloatArray
    channel: IdArray
    surface_m_s: FloatArray
    along_m_s: FloatArray
    sigma_m_s: FloatArray
    count: IdArray
    measured: BoolArray
    part_m3_s: FloatArray

    @property
    def wet(self) -> BoolArray:
        """(N,), which lie under water."""
        return self.depth_m > 0


@dataclass(frozen=True)
class Shares:
    """Parts of the discharge by where their velocities come from; their sum is 1.

    Attributes:
        measured: at verticals with vectors.
        interpolated: at verticals between such ones of their channel.
        extrapolated: beyond them.
    """

    measured: float
    interpolated: float
    extrapolated: float


@dataclass(frozen=True, eq=False)
class Discharge:
    """A discharge with its uncertainty.

    Attributes:
        q_m3_s: the discharge.
        sigma_m3_s: its standard deviation, by Monte Carlo.
        low_m3_s: lower bound of the interval in which it lies with 95 %.
        high_m3_s: upper bound.
        shares: of it, measured and filled.
        measured_width_share: share of the width of the water surface that belongs to verticals with vectors.
        wse_m: water surface elevation.
        area_m2: wetted area.
        width_m: width of the water surface.
        mean_m_s: mean velocity, discharge over area.
        iso_sigma: relative standard deviation by ISO 748.
        ive_sigma: relative standard deviation by the interpolated variance estimator; NaN: too few verticals.
        sources_m3_s: standard deviation that each source alone gives.
        drawn_m3_s: (draws,), of the Monte Carlo.
        verticals: where it comes from.
        search_m: the search distance.
        downstream: (2,), unit vector across the section in the map.
        vectors: number of vectors that were used.
        start_ns: stamp of the first vector used.
        end_ns: stamp of the last one.
        warnings: one line each.
    """

    q_m3_s: float
    sigma_m3_s: float
    low_m3_s: float
    high_m3_s: float
    shares: Shares
    measured_width_share: float
    wse_m: float
    area_m2: float
    width_m: float
    mean_m_s: float
    iso_sigma: float
    ive_sigma: float
    sources_m3_s: Mapping[str, float]
    drawn_m3_s: FloatArray
    verticals: Verticals
    search_m: float
    downstream: FloatArray
    vectors: int
    start_ns: int
    end_ns: int
    warnings: tuple[str, ...]
