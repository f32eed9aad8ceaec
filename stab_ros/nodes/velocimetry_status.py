"""The status of velocimetry on /diagnostics, counted here; without ROS."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np

from stab_ros.core.text import number
from stab_ros.nodes.georeference_status import GeoreferenceStatus
from stab_ros.velocimetry.bank import BankVelocity
from stab_ros.velocimetry.bank_over_time import bank_of, over_time, told
from stab_ros.velocimetry.dropped import bed_doubt
from stab_ros.velocimetry.speeds import sigma_speed_m_s, speed_m_s
from stab_ros.velocimetry.vectors import Unit, Vectors
from stab_ros.velocimetry.velocimeter import Measured

_BANK_INTERVALS = 10  # over which the bank is judged


class VelocimetryStatus(GeoreferenceStatus):
    """Counts what becomes of images and of intervals."""

    def __init__(self, orientation: str, stale_ns: int, unit: Unit) -> None:
        super().__init__(orientation, stale_ns)
        self._unit = unit
        self._intervals = self._vectors = 0
        self._dropped: Counter[str] = Counter()
        self._bed_told = False
        self._last: Vectors | None = None
        self._bank: deque[BankVelocity] = deque(maxlen=_BANK_INTERVALS)
        self._latency_ms: float | None = None

    def on_measured(self, measured: Measured, latency_ns: int) -> None:
        """An interval of the water. latency_ns: from the publication of its last image to that of its vectors."""
        self._intervals += 1
        self._vectors += len(measured.vectors)
        self._dropped.update(measured.dropped)
        self._last, self._latency_ms = measured.vectors, latency_ns / 1e6
        for kind, doubt in measured.doubts.items():
            self.warn(kind, doubt)
        bed = bed_doubt(self._dropped, self._vectors, measured.doubts)
        if bed and not self._bed_told:
            self._bed_told = True
            self.warn("bed", bed)
        if not len(measured.vectors):
            self.warn("no vectors", "the last interval has no vector: the water shows nothing that can be followed")

    def on_bank(self, measured: Measured) -> None:
        """An interval of the bank."""
        self._bank.append(bank_of(measured))
        bank = over_time(self._bank)
        if bank.at_rest is False:
            self.warn("bank", f"the bank moves by {told(bank, self._unit)}; the frames do not lie still")

    def _values(self, state: str) -> dict[str, str]:
        last, unit = self._last, self._unit
        speed = None if last is None or not len(last) else float(np.median(speed_m_s(last)))
        sigma = None if last is None or not len(last) else float(np.median(sigma_speed_m_s(last)))
        bank = over_time(self._bank)
        x, y, sigma_x, sigma_y = (*bank.median_m_s.tolist(), *bank.sigma_m_s.tolist()) if bank.count else (None,) * 4
        return {
            **super()._values(state),
            "intervals": str(self._intervals),
            "vectors": str(self._vectors),
            **{f"dropped_{reason}": str(count) for reason, count in self._dropped.items()},
            "unit": f"{unit}/s",
            "median_speed": number(speed),
            "median_sigma": number(sigma),
            "bank_vx": number(x),
            "bank_vy": number(y),
            "bank_sigma_vx": number(sigma_x),
            "bank_sigma_vy": number(sigma_y),
            "velocity_latency_ms": "" if self._latency_ms is None else f"{self._latency_ms:.3f}",
        }
