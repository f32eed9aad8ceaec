"""A discharge every few seconds, from the vectors of the last ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stab_ros.core.errors import InputError
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.discharge.measure import measure
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.settings import DischargeConfig, RunningConfig
from stab_ros.georeferencing.level_doubts import stale_level
from stab_ros.velocimetry.speeds import joined
from stab_ros.velocimetry.vectors import Vectors

_NS = 1e9


@dataclass(frozen=True, eq=False)
class Reading:
    """What a running discharge says at a time.

    Attributes:
        stamp_ns: the time.
        discharge: of the window that ends there; None: there is none.
        reason: why not, in one line; empty where there is one.
        warnings: one line each, those of the discharge and on the water level.
    """

    stamp_ns: int
    discharge: Discharge | None
    reason: str = ""
    warnings: tuple[str, ...] = ()


class RunningDischarge:
    """Gathers vectors and water levels, and measures on time.

    Args:
        section: in the map.
        config: methods and uncertainties.
        running: window and times.
        wse_m: water surface elevation until a level comes; None: there is no discharge before.
    """

    def __init__(self, section: CrossSection, config: DischargeConfig, running: RunningConfig,
                 wse_m: float | None = None) -> None:
        self._section, self._config, self._running = section, config, running
        self._given_m = wse_m
        self._level: tuple[int, float] | None = None  # the newest, with its stamp
        self._parts: list[Vectors] = []
        self._due_ns: int | None = None
        self._last_ns = 0

    def reconfigure(self, config: DischargeConfig) -> None:
        """Measures by other settings from the next discharge on."""
        self._config = config

    def set_level(self, stamp_ns: int, wse_m: float) -> None:
        """Takes a water level, which holds until a newer one comes; an older one is ignored.

        Raises:
            InputError: not finite.
        """
        if not math.isfinite(wse_m):
            raise InputError(f"a water level of {wse_m} m, it must be finite")
        if self._level is None or stamp_ns >= self._level[0]:
            self._level = stamp_ns, wse_m

    def add(self, stamp_ns: int, vectors: Vectors | None) -> Reading | None:
        """Takes the vectors of an interval.

        Args:
            stamp_ns: of the frame that ends it.
            vectors: of it; None or none at all: the frame had none.

        Returns:
            The discharge of the window that ends here, where one is due; None before.
        """
        self._restart_after_jump(stamp_ns)
        if vectors is not None and len(vectors):
            self._parts = [part for part in self._parts if _alike(part, vectors)] + [vectors]
        self._last_ns = stamp_ns
        every_ns = round(self._running.every_s * _NS)
        if self._due_ns is None:
            self._due_ns = stamp_ns + every_ns
        if stamp_ns < self._due_ns:
            return None
        self._due_ns += every_ns * (1 + (stamp_ns - self._due_ns) // every_ns)
        return self._reading(stamp_ns)

    def _restart_after_jump(self, stamp_ns: int) -> None:
        """Stamps that jump back, as when a recording starts anew, begin a new series."""
        if stamp_ns < self._last_ns - round(self._running.window_s * _NS):
            self._parts, self._due_ns, self._level = [], None, None

    def _reading(self, stamp_ns: int) -> Reading:
        first_ns = stamp_ns - round(self._running.window_s * _NS)
        self._parts = [kept for part in self._parts if len(kept := part[part.end_ns > first_ns])]
        doubts, wse_m = self.level_doubts(stamp_ns), self._wse_m
        if wse_m is None:
            return Reading(stamp_ns, None, doubts[0])
        try:
            found = measure(joined(self._parts), self._section, wse_m, self._config)
        except InputError as error:
            return Reading(stamp_ns, None, str(error), doubts)
        return Reading(stamp_ns, found, "", (*doubts, *found.warnings))

    @property
    def _wse_m(self) -> float | None:
        return self._given_m if self._level is None else self._level[1]

    @property
    def has_level(self) -> bool:
        """Whether a level has come, in place of `wse_m`."""
        return self._level is not None

    def level_doubts(self, stamp_ns: int) -> tuple[str, ...]:
        """That there is no water level at a time, or only a stale one; in one line, if any."""
        if self._wse_m is None:
            return ("no water level has come, and none is given (wse_m)",)
        if self._level is None:
            return ()
        return stale_level((stamp_ns - self._level[0]) / _NS, self._running.water_level_timeout_s)


def _alike(one: Vectors, other: Vectors) -> bool:
    """Whether vectors are of one setup: unit and number of common errors."""
    return one.unit == other.unit and one.shared.shape[2] == other.shared.shape[2]
