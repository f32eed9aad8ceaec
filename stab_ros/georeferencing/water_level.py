"""The water surface elevation over time."""

from __future__ import annotations

import bisect
import math

from stab_ros.core.errors import InputError


class WaterLevels:
    """Each level holds from its stamp on; before the first one, that of the settings does."""

    def __init__(self, wse_m: float) -> None:
        self._first_m = wse_m
        self._levels: list[tuple[int, float]] = []  # in the order of their stamps

    def add(self, stamp_ns: int, wse_m: float) -> None:
        """Takes a level in the map; a second one of the same stamp replaces the first.

        Raises:
            InputError: not finite.
        """
        if not math.isfinite(wse_m):
            raise InputError(f"a water level of {wse_m} m, it must be finite")
        at = bisect.bisect_left(self._levels, (stamp_ns, -math.inf))
        same = at < len(self._levels) and self._levels[at][0] == stamp_ns
        self._levels[at : at + same] = [(stamp_ns, wse_m)]

    def at(self, stamp_ns: int) -> float:
        """The level at a stamp, m."""
        after = bisect.bisect_right(self._levels, (stamp_ns, math.inf))
        return self._levels[after - 1][1] if after else self._first_m
