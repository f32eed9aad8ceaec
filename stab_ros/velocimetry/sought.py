"""What is to be said where windows or lines lost what they follow: how far was sought, and what may be faster."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stab_ros.core.types import BoolArray
from stab_ros.velocimetry.lspiv_first import Shifts
from stab_ros.velocimetry.vectors import Unit

_MANY = 0.5  # share of what was sought from which on it is told


def lost_doubt(lost: int, sought: int, what: str, or_else: str, limit: str) -> str:
    """What is to be said where `lost` of all `sought` have nothing within a limit of speed; empty: few were lost.

    Args:
        lost: number of those.
        sought: number of all.
        what: they are and do not have, as "windows with texture have no clear peak".
        or_else: what else may be the reason.
        limit: the speed up to which they were sought, and the parameter that sets it, as "2 m/s (max_speed)".
    """
    if lost <= _MANY * sought:
        return ""
    return f"{lost} of {sought} {what} up to {limit}; the water may be faster, or {or_else}"


def doubts_of_windows(shifts: Shifts, found: BoolArray, ground: BoolArray, px_m_s: float, limit_m_s: float,
                      unit: Unit) -> Mapping[str, str]:
    """What is doubtful of a search, by kind.

    Args:
        shifts: of the search.
        found: (N,), windows that have a velocity after all.
        ground: (N,), those of them that were taken for ground.
        px_m_s: speed of a shift of a pixel.
        limit_m_s: up to which speed they were sought.
        unit: of lengths.
    """
    lost = shifts.textured & ~found
    repeats = lost & np.isfinite(shifts.period_px)
    count, sought, alike, still = (int(np.count_nonzero(these)) for these in
                                   (lost, shifts.textured | found, repeats, ground))
    if alike > _MANY * sought:
        alike_m_s = float(np.median(shifts.period_px[repeats])) * px_m_s
        return {"repeats": f"{alike} of {sought} windows have a texture that repeats, and no vector: speeds that "
                           f"differ by {alike_m_s:.3g} {unit}/s look alike; lspiv.max_speed_m_s, little above the "
                           "fastest water, may tell them apart"}
    limit = f"{limit_m_s:.3g} {unit}/s (lspiv.max_speed_m_s)"
    if still:
        return {"lost": f"{count} of {sought} windows with texture have no clear peak up to {limit}, and {still} that "
                        "stand still beside them are left out as ground; the water may be faster"}
    doubt = lost_doubt(count, sought, "windows with texture have no clear peak", "its texture does not last", limit)
    return {"lost": doubt} if doubt else {}
