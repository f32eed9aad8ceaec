"""What makes a discharge doubtful, in words."""

from __future__ import annotations

import numpy as np

from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.discharge.integration import mid_section
from stab_ros.discharge.result import Shares, Verticals
from stab_ros.discharge.wetted import DRY

_STRAYING = 0.05  # of the length, from which points beside the line are mentioned
_FEW = 7  # verticals, from which they tell by themselves how rough the section is
_MUCH = 0.3  # share of the discharge
_PART, _FLOWS = 0.05, 0.2  # share of the area without vectors, which carries less than that part of its share
_STEEP = 0.2  # relief of a bed over its width; more is rare in rivers
_OBLIQUE = 0.36  # tangent of 20 degrees
_DIFFERS_SIGMAS, _DIFFERS_M = 3.0, 0.05  # from which two water levels contradict each other


def looks_like_depths(heights_m: FloatArray) -> bool:
    """Whether heights along a section look like depths: shores near 0, if below it, and more between them."""
    ends, most = max(abs(float(heights_m[0])), abs(float(heights_m[-1]))), float(heights_m.max())
    return bool(len(heights_m) > 2 and most > 0 and ends <= 0.2 * most and float(heights_m.min()) >= -0.2 * most)


def looks_like_elevations(depths_m: FloatArray) -> bool:
    """Whether depths along a section look like elevations: the ends are deepest, or all depths are far from 0."""
    inner, ends = float(depths_m.min()), np.sort(depths_m[[0, -1]])
    hollow = inner < 0.98 * float(ends[0]) and float(depths_m.max()) <= float(ends[1])
    offset = float(depths_m.min()) > 5 * float(np.ptp(depths_m)) > 0
    return bool(len(depths_m) > 2 and (hollow or offset))


def section_doubts(section: CrossSection, table: Verticals, wse_m: float) -> list[str]:
    """About the section itself."""
    found = []
    length_m = float(np.ptp(section.chainage_m))
    stray_m = float(np.abs(section.offset_m).max())
    if stray_m > _STRAYING * length_m:
        found.append(f"points of the section lie up to {stray_m:.2g} m beside its straight line; widths are taken "
                     "along the line")
    for end, side in ((0, "start"), (-1, "end")):
        if table.wet[end]:
            found.append(f"the section {side}s under water, {table.depth_m[end]:.2g} m deep; what flows beyond it is "
                         "missing")
    if float(table.depth_m.max()) > _STEEP * length_m:
        found.append(f"a depth of {table.depth_m.max():.3g} m in a section of {length_m:.3g} m: check units, height "
                     "datum, and whether its heights are elevations or depths")
    if looks_like_depths(section.bed_m) and wse_m > 0:
        found.append("the elevations of the section rise from its ends to its middle, as depths do: if they are "
                     "depths, their column must be named depth")
    return found


def surface_doubts(used_m: float | None, wse_m: float, wse_sigma_m: float) -> tuple[str, ...]:
    """That the velocities lie on another water surface, whose scale they have.

    Args:
        used_m: water surface elevation at which they were measured; None: not known.
        wse_m: that of the discharge.
        wse_sigma_m: its standard deviation.
    """
    if used_m is None or abs(used_m - wse_m) <= max(_DIFFERS_M, _DIFFERS_SIGMAS * wse_sigma_m):
        return ()
    return (f"the velocities were measured on a water surface at {used_m:.6g} m, the discharge is asked for at "
            f"{wse_m:.6g} m; both must be one",)


def coverage_doubts(table: Verticals, shares: Shares) -> list[str]:
    """About what the vectors leave open."""
    found = [*_empty_halves(table), *_empty_channels(table)]
    if (number := int(table.measured.sum())) < _FEW:
        found.append(f"only {counted(number, 'vertical is', 'verticals are')} measured, there should be {_FEW} or more")
    if shares.extrapolated > _MUCH:
        found.append(f"{shares.extrapolated:.0%} of the discharge is extrapolated beyond the measured verticals")
    if shares.interpolated > _MUCH:
        found.append(f"{shares.interpolated:.0%} of the discharge is interpolated between measured verticals")
    found += _idle_area(table, shares)
    across, along = (float(np.nanmedian(values[table.measured])) for values in (table.surface_m_s, table.along_m_s))
    if abs(along) > _OBLIQUE * abs(across):
        angle = np.degrees(np.arctan2(abs(along), abs(across)))
        found.append(f"the water crosses the section {angle:.0f} degrees off its normal; a section square to the flow "
                     "is more accurate")
    back = table.measured & (table.surface_m_s < -2 * np.nan_to_num(table.sigma_m_s))
    if back.any():
        where = counted(int(back.sum()), "vertical, which counts", "verticals, which count")
        found.append(f"the water flows upstream at {where} as negative")
    return found


def _idle_area(table: Verticals, shares: Shares) -> list[str]:
    """That the part without vectors carries next to nothing, as where no water is."""
    area_m2 = mid_section(table.chainage_m, table.depth_m, np.ones_like(table.depth_m))
    empty, carries = 1 - float(area_m2[table.measured].sum() / area_m2.sum()), 1 - shares.measured
    if empty < _PART or carries >= _FLOWS * empty:
        return []
    return [f"{empty:.0%} of the wetted area has no vectors and carries {carries:.1%} of the discharge: the water next "
            "to it is as good as still; where no water stands, the water level is too high, the section lies in the "
            "wrong place, or the scale is wrong"]


def _empty_halves(table: Verticals) -> list[str]:
    wet = np.flatnonzero(table.wet)
    middle_m = table.chainage_m[wet[[0, -1]]].mean()
    found = []
    for half, side in ((table.chainage_m <= middle_m, "first"), (table.chainage_m > middle_m, "second")):
        verticals = int((half & table.wet).sum())
        if verticals and not (half & table.measured).any():
            found.append(f"no vectors in the {side} half of the section (0 of {counted(verticals, 'vertical')}): its "
                         "velocities are extrapolated")
    return found


def _empty_channels(table: Verticals) -> list[str]:
    numbers = [int(one) for one in np.unique(table.channel[table.channel != DRY])]
    empty = [one for one in numbers if not (table.measured & (table.channel == one)).any()]
    return [f"no vectors in channel {one + 1} of {len(numbers)}: its velocities come from the nearest measured "
            "verticals of the others" for one in empty]
