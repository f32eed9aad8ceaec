"""Whether a section whose numbers are read as feet fits the velocities that it does not fit as it is.

Mostly the water that moves tells it: it must reach from shore to shore of the section. As vectors may cover a part
of the water alone, another unit is mentioned only where the section covers them badly as it is, well in feet, and where
they slow down towards both their ends, as water does towards shores.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.discharge.wetted import shores_m
from stab_ros.georeferencing.unit_checks import FOOT_M, is_feet
from stab_ros.velocimetry.vectors import Vectors

_FEWEST = 30  # vectors that show where the water is
_MOVES = 0.1  # of the fast vectors' speed; slower ones may lie on the bank
_FAST = 0.9  # quantile
_ENDS = 0.02  # share of vectors beyond each end of the water, which may be wrong ones
_OUTER = 0.15  # share of the width at each end
_BESIDE = 0.25  # of the wet width, how far up- and downstream of the section vectors tell its water
_BAD, _GOOD = 0.5, 0.75  # length that section and vectors have in common, over that which one of them has


def in_feet(section: CrossSection, vectors: Vectors, wse_m: float) -> tuple[str, ...]:
    """What of a section seems to be in feet, in one line; nothing where the vectors do not tell.

    Args:
        section: as read, in metres.
        vectors: surface velocities in the map, m.
        wse_m: water surface elevation.
    """
    if _fit(section, vectors, wse_m) >= _BAD:
        return ()
    fits = {what: _fit(other, vectors, wse_m) for what, other in _readings(section)}
    best = max(fits, key=lambda what: fits[what])
    if fits[best] < _GOOD:
        return _by_the_line(section)
    return (f"read as feet, the {best} of the section fit the water that the velocities show, as metres they do not: "
            "if they are in feet, their columns must say so, as in Z (ft)",)


def _by_the_line(section: CrossSection) -> tuple[str, ...]:
    """What the places that were given for the line tell, where they are its ends."""
    length_m = float(np.ptp(section.chainage_m))
    if section.line_m is None or length_m < section.line_m or not is_feet(length_m / section.line_m):
        return ()
    return (f"the distances of the section reach over {length_m:.4g} m, the places between which they lie are "
            f"{section.line_m:.4g} m apart: if they are in feet, their column must say so, as in chainage (ft)",)


def _readings(section: CrossSection) -> Iterator[tuple[str, CrossSection]]:
    yield "places", section.with_places_times(FOOT_M)
    yield "heights", replace(section, bed_m=section.bed_m * FOOT_M)
    yield "places and heights", replace(section.with_places_times(FOOT_M), bed_m=section.bed_m * FOOT_M)


def _fit(section: CrossSection, vectors: Vectors, wse_m: float) -> float:
    """Length that the water of a section and that of the vectors have in common, over the length of both together."""
    depth_m = wse_m - section.bed_m
    wet = depth_m > 0
    if not wet.any():
        return 0.0
    shores = _shores(section.chainage_m, depth_m)
    seen = _seen(section, vectors, _BESIDE * float(np.ptp(shores)))
    if seen is None:
        return 0.0
    both = np.minimum(shores, seen)[1] - np.maximum(shores, seen)[0]
    return float(both / (np.maximum(shores, seen)[1] - np.minimum(shores, seen)[0]))


def _shores(chainage_m: FloatArray, depth_m: FloatArray) -> FloatArray:
    """(2,), where the water begins and ends; islands count as water."""
    wet = np.flatnonzero(depth_m > 0)
    water = np.zeros(len(depth_m), np.bool_)
    water[wet[0] : wet[-1] + 1] = True
    found = shores_m(chainage_m, depth_m, water)
    return np.array([min([chainage_m[wet[0]], *found]), max([chainage_m[wet[-1]], *found])])


def _seen(section: CrossSection, vectors: Vectors, beside_m: float) -> FloatArray | None:
    """(2,), chainages between which vectors near a section show water; None: they do not show where it ends."""
    away = vectors.position_m - section.position_m[0]
    near = np.abs(away @ section.normal + section.offset_m[0]) <= beside_m
    chainage_m = away[near] @ section.along + section.chainage_m[0]
    speed = np.abs(vectors.velocity_m_s[near] @ section.normal)
    if len(speed) < _FEWEST:
        return None
    moves = speed > _MOVES * np.quantile(speed, _FAST)
    ends = np.quantile(chainage_m[moves], (_ENDS, 1 - _ENDS))
    return ends if _slows_down(chainage_m[moves], speed[moves], ends) else None


def _slows_down(chainage_m: FloatArray, speed: FloatArray, ends: FloatArray) -> bool:
    """Whether water is slower towards both ends."""
    outer_m = _OUTER * float(np.ptp(ends))
    first, last = chainage_m <= ends[0] + outer_m, chainage_m >= ends[1] - outer_m
    middle = float(np.median(speed[~(first | last)])) if (~(first | last)).any() else 0.0
    return bool(np.median(speed[first]) < middle and np.median(speed[last]) < middle)
