"""From vectors, a cross-section and a water level to a discharge."""

from __future__ import annotations

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.discharge.doubts import coverage_doubts, section_doubts
from stab_ros.discharge.dry_ground import dry_ground_doubts
from stab_ros.discharge.filling import FILLINGS
from stab_ros.discharge.filling_kriged import kriging_sigma_m_s
from stab_ros.discharge.integration import INTEGRATIONS
from stab_ros.discharge.interpolated_variance import Roughness, relative_sigma, roughness
from stab_ros.discharge.iso748 import Iso748, sigma_by_number
from stab_ros.discharge.measured import Measured
from stab_ros.discharge.monte_carlo import Noise, discharges, interval, sources
from stab_ros.discharge.result import Discharge, Shares, Verticals
from stab_ros.discharge.section_units import in_feet
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.discharge.surface import SurfaceVelocities, surface_velocities
from stab_ros.discharge.wetted import DRY, area_m2, channels, wet_lengths_m
from stab_ros.velocimetry.vectors import Vectors

_ISO = Iso748()
_SYSTEMATIC = ("alpha", "water level", "shared", "filling")


def measure(vectors: Vectors, section: CrossSection, wse_m: float, config: DischargeConfig) -> Discharge:
    """The discharge through a section.

    Args:
        vectors: surface velocities in the map, m.
        section: bed elevations across the river, in the same map.
        wse_m: water surface elevation, in the heights of the section.
        config: methods and uncertainties.

    Raises:
        InputError: the vectors are in pixels, the section is dry, or no vertical has vectors.
    """
    _check_unit(vectors)
    verticals = _verticals(section, wse_m, config)
    depth = wse_m - verticals.bed_m
    _check_wet(verticals, vectors, wse_m)
    search_m = config.search_m or _search_m(verticals, depth)
    surface = surface_velocities(verticals, depth > 0, vectors, search_m, config.min_vectors)
    _check_known(surface, search_m, config, in_feet(section, vectors, wse_m))
    measured = Measured(verticals.chainage_m, depth, channels(depth), surface.known)
    velocity = np.where(surface.known, surface.velocity_m_s, 0.0)
    filled = np.where(depth > 0, FILLINGS[config.filling](measured, depth[None], velocity[None])[0], 0.0)
    part = INTEGRATIONS[config.integration](verticals.chainage_m, depth, config.alpha * filled)
    table = Verticals(verticals.position_m, verticals.chainage_m, verticals.bed_m, depth, measured.channel, filled,
                      surface.along_m_s, _total_sigma(surface), surface.count, surface.known, part)
    return _with_uncertainty(table, measured, surface, wse_m, search_m, section, vectors, config)


def _check_unit(vectors: Vectors) -> None:
    if vectors.unit != "m":
        raise InputError("velocities in px/s make no discharge; they must be in m/s, of a georeferenced recording")


def _verticals(section: CrossSection, wse_m: float, config: DischargeConfig) -> CrossSection:
    """The survey's points, or as many evenly spaced ones over the wet width as the settings say."""
    wet = np.flatnonzero(section.bed_m < wse_m)
    if not config.verticals or not len(wet):
        return section
    first, last = max(int(wet[0]) - 1, 0), min(int(wet[-1]) + 1, len(section) - 1)
    low, high = section.chainage_m[[first, last]]
    step = (high - low) / (config.verticals + 1)
    inner = low + step * np.arange(1, config.verticals + 1)
    return section.at(np.concatenate([section.chainage_m[: first + 1], inner, section.chainage_m[last:]]))


def _check_wet(section: CrossSection, vectors: Vectors, wse_m: float) -> None:
    if section.bed_m.min() < wse_m:
        return
    why = in_feet(section, vectors, wse_m) or ("both must have one height datum (or are its numbers depths?)",)
    raise InputError(f"the section is dry: its lowest point is {section.bed_m.min():.6g} m high, the water surface "
                     f"{wse_m:.6g} m; {why[0]}")


def _search_m(section: CrossSection, depth_m: FloatArray) -> float:
    """Half the mean distance of the wet verticals; several in one place, as at a wall, are one."""
    width_m = float(wet_lengths_m(section.chainage_m, depth_m).sum())
    return width_m / (2 * len(np.unique(section.chainage_m[depth_m > 0])))


def _check_known(surface: SurfaceVelocities, search_m: float, config: DischargeConfig, feet: tuple[str, ...]) -> None:
    if surface.known.any():
        return
    if surface.count.any():
        raise InputError(f"no vertical has {config.min_vectors} vectors within {search_m:.3g} m, at most "
                         f"{surface.count.max()}; give a larger search distance, or a smaller min_vectors")
    if not np.isfinite(surface.nearest_m):
        raise InputError("there is no vector; a discharge must have measured velocities")
    why = feet or ("the section must cross the measured water, in the coordinates of the map",)
    raise InputError(f"no vector lies within {search_m:.3g} m of the wet section, the nearest is "
                     f"{surface.nearest_m:.4g} m away; {why[0]}")


def _total_sigma(surface: SurfaceVelocities) -> FloatArray:
    sigma = np.sqrt(surface.sigma_m_s**2 + (surface.shared_m_s**2).sum(axis=1))
    return np.asarray(np.where(surface.known, sigma, np.nan))


def _with_uncertainty(table: Verticals, measured: Measured, surface: SurfaceVelocities, wse_m: float, search_m: float,
                      section: CrossSection, vectors: Vectors, config: DischargeConfig) -> Discharge:
    wet = table.wet
    rough = roughness(table.chainage_m[wet], table.depth_m[wet], table.surface_m_s[wet], table.measured[wet])
    velocity = np.where(surface.known, surface.velocity_m_s, 0.0)
    noise = _noise(surface, rough, _filling_sigma_m_s(table, measured, velocity, config), config)
    drawn = discharges(measured, velocity, noise, config)
    by_source = sources(measured, velocity, noise, config)
    q, area = float(table.part_m3_s.sum()), float(area_m2(table.chainage_m, table.depth_m))
    systematic = float(np.sqrt(sum(by_source[name] ** 2 for name in _SYSTEMATIC))) / abs(q) if q else float("nan")
    low, high = interval(drawn)
    used = _used(vectors, table, search_m)
    return Discharge(
        q, float(drawn.std()), min(low, q), max(high, q), _shares(table), _width_share(table), wse_m,
        area,
        float(wet_lengths_m(table.chainage_m, table.depth_m).sum()), q / area,
        _ISO.relative_sigma(table.depth_m[wet], table.part_m3_s[wet], int(table.measured.sum()), systematic),
        relative_sigma(rough, table.depth_m[wet], config.alpha * table.surface_m_s[wet], table.part_m3_s[wet],
                       _ISO.width, systematic),
        by_source, drawn, table, search_m, surface.downstream, len(used), int(used.start_ns.min()),
        int(used.end_ns.max()), _doubts(table, surface, section, vectors, wse_m, config))


def _doubts(table: Verticals, surface: SurfaceVelocities, section: CrossSection, vectors: Vectors, wse_m: float,
            config: DischargeConfig) -> tuple[str, ...]:
    fastest_m_s = float(np.nanmax(np.abs(surface.velocity_m_s)))
    dry = dry_ground_doubts(section, vectors, surface.downstream, fastest_m_s, wse_m, config)
    return (*section_doubts(section, table, wse_m), *dry, *in_feet(section, vectors, wse_m),
            *coverage_doubts(table, _shares(table)))


def _filling_sigma_m_s(table: Verticals, measured: Measured, velocity_m_s: FloatArray, config: DischargeConfig
                       ) -> FloatArray:
    """(N,), of filled velocities: by their distance from measured ones or by kriging, whichever is larger."""
    far = config.filling_sigma * measured.away * np.abs(table.surface_m_s)
    return np.maximum(far, kriging_sigma_m_s(measured, velocity_m_s)) if config.filling_sigma else far


def _noise(surface: SurfaceVelocities, rough: Roughness, filling_m_s: FloatArray, config: DischargeConfig) -> Noise:
    """What is drawn: a vertical is at least as uncertain as its difference from its neighbours says.

    Too few verticals do not say it, so their number counts, as in ISO 748.
    """
    bed_m = max(config.depth_sigma_m, np.nan_to_num(rough.depth_m))
    single = np.maximum(np.nan_to_num(surface.sigma_m_s), np.nan_to_num(rough.velocity_m_s))
    return Noise(config.alpha_sigma, config.wse_sigma_m, bed_m, np.where(surface.known, single, 0.0),
                 surface.shared_m_s, filling_m_s,
                 sigma_by_number(int(surface.known.sum())) if np.isnan(rough.velocity_m_s) else 0.0)


def _used(vectors: Vectors, table: Verticals, search_m: float) -> Vectors:
    """The vectors within the search distance of a measured vertical."""
    distance_m = np.full(len(vectors), np.inf)
    for place in table.position_m[table.measured]:
        distance_m = np.minimum(distance_m, np.linalg.norm(vectors.position_m - place, axis=1))
    return vectors[distance_m <= search_m]


def _shares(table: Verticals) -> Shares:
    part = np.abs(table.part_m3_s) if table.part_m3_s.any() else np.maximum(table.depth_m, 0.0)  # still water
    between = _between(table)
    total = float(part.sum()) or 1.0
    measured, interpolated = (float(part[which].sum()) / total for which in (table.measured, between))
    return Shares(measured, interpolated, max(1.0 - measured - interpolated, 0.0))


def _width_share(table: Verticals) -> float:
    """Of the wet width, the part of measured verticals: half of the way to each wet neighbour, or all to a shore."""
    wet_m = wet_lengths_m(table.chainage_m, table.depth_m)
    ends, measured = (which[:-1].astype(int) + which[1:] for which in (table.wet, table.measured))
    return float((wet_m * measured / np.maximum(ends, 1)).sum() / wet_m.sum())


def _between(table: Verticals) -> BoolArray:
    """Filled verticals with measured ones of their channel on both sides."""
    found = np.zeros(len(table.measured), np.bool_)
    for channel in np.unique(table.channel[table.channel != DRY]):
        own = np.flatnonzero(table.measured & (table.channel == channel))
        if len(own):
            found[own[0] : own[-1] + 1] = True
    return found & ~table.measured & table.wet
