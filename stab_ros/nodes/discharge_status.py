"""The status of the discharge node on /diagnostics, counted here; without ROS."""

from __future__ import annotations

from collections.abc import Mapping

from stab_ros.core.text import number
from stab_ros.discharge.running import Reading
from stab_ros.io.diagnostics_message import ERROR, OK, WARN
from stab_ros.io.discharge_message import discharge_text, discharge_values
from stab_ros.nodes.diagnostic_status import DiagnosticStatus, Summary
from stab_ros.nodes.stream_timeout import StreamTimeout

_COUNTS = ("intervals", "vectors_in", "water_levels", "messages_refused", "discharges", "discharges_missing")
_LEVELS = {"GATHERING": OK, "MEASURED": OK, "STALE": ERROR}  # all else: WARN


class DischargeStatus:
    """Counts what becomes of messages. Times are of the node's free time, ns, unless they are stamps."""

    def __init__(self, stale_ns: int, doubts: tuple[str, ...]) -> None:
        """doubts: of the section."""
        self.waiting_for = "velocities"
        self.level_doubts: tuple[str, ...] = ()  # until there is a reading, which has them among its own
        self.level_missing = ""  # why none has come, where that is doubtful
        self.level_from = ""  # "water_level", "wse_m", or "" for none
        self.faults: Mapping[str, str] = {}  # of publishers, by topic
        self.errors = 0
        self._doubts = doubts
        self._timeout = StreamTimeout(stale_ns)
        self._counts = dict.fromkeys(_COUNTS, 0)
        self._warnings: dict[str, str] = {}  # by kind, until the next report
        self._newest_ns: int | None = None  # stamp of the last velocities
        self._level_ns: int | None = None
        self._reading: Reading | None = None

    def on_velocity(self, stamp_ns: int, vectors: int, free_ns: int) -> None:
        """An interval that is taken."""
        self._timeout.on_image(free_ns)
        self._newest_ns = stamp_ns
        self.count("intervals")
        self.count("vectors_in", vectors)

    def suspend(self) -> None:
        """No velocities are expected until the next ones."""
        self._timeout.suspend()

    def on_level(self, stamp_ns: int) -> None:
        """From when the last water level holds."""
        self._level_ns = stamp_ns

    def on_reading(self, reading: Reading) -> None:
        """A discharge was due."""
        self.count("discharges_missing" if reading.discharge is None else "discharges")
        self._reading = reading

    def count(self, what: str, more: int = 1) -> None:
        """Adds to one of the counts."""
        self._counts[what] += more

    def warn(self, kind: str, text: str) -> None:
        """A warning for the next report; the last one of each kind is kept."""
        self._warnings[kind] = text

    def report(self, free_ns: int) -> DiagnosticStatus:
        """The status since the last report."""
        state = self._state(free_ns)
        once, self._warnings = self._warnings, {}
        warnings = [*self._doubts, *self._doubts_of_stream(), *once.values()]
        level = _LEVELS.get(state, WARN)
        message = "; ".join([self._message(state, free_ns), *warnings])
        lasting = [*self._doubts, *once.values()]
        inactive = Summary(WARN if lasting else OK, "; ".join(["takes no velocities", *lasting]))
        return DiagnosticStatus(max(level, WARN) if warnings else level, message, self._values(state), inactive)

    def _doubts_of_stream(self) -> list[str]:
        of_reading = self.level_doubts if self._reading is None else self._reading.warnings
        return [*of_reading, *filter(None, [self.level_missing]), *self.faults.values()]

    def _state(self, free_ns: int) -> str:
        if not self._timeout.has_begun:
            return "WAITING"
        if self._timeout.is_stale(free_ns):
            return "STALE"
        if self._reading is None:
            return "GATHERING"
        return "UNMEASURED" if self._reading.discharge is None else "MEASURED"

    def _message(self, state: str, free_ns: int) -> str:
        if state == "WAITING":
            return f"waiting for {self.waiting_for}"
        if state == "STALE":
            return f"no velocities for {self._timeout.silence_ns(free_ns) / 1e9:.1f} s"
        return "gathering velocities" if self._reading is None else discharge_text(self._reading)

    def _values(self, state: str) -> dict[str, str]:
        level_ns, newest_ns = self._level_ns, self._newest_ns
        age_s = None if level_ns is None or newest_ns is None else (newest_ns - level_ns) / 1e9
        return {
            "state": state,
            **({} if self._reading is None else discharge_values(self._reading)),
            "stamp_ns": "" if self._reading is None else str(self._reading.stamp_ns),
            **{name: str(count) for name, count in self._counts.items()},
            "internal_errors": str(self.errors),
            "water_level_from": self.level_from,
            "water_level_age_s": number(age_s),
        }
