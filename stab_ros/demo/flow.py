"""Velocities of the sample's water and the discharge through a made-up section, beside what is known of both."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from stab_ros.core.settings import Value
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.demo.replay import RAW
from stab_ros.demo.stages import bar
from stab_ros.demo.water import KnownWater, write_section
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.jobs.discharge import DischargeJob, discharge_from_files
from stab_ros.jobs.velocity import Job, velocity
from stab_ros.velocimetry.bank import BankVelocity
from stab_ros.velocimetry.speeds import sigma_speed_m_s, speed_m_s
from stab_ros.velocimetry.vectors import Vectors

RUNS_M_S = 0.3  # slower water is the shore's, where the bed shows through and windows hold both
_SEARCH_M = 1.5  # around each vertical of the section, which are 1 m apart; three seconds give few vectors


@dataclass(frozen=True, eq=False)
class Flow:
    """What was measured: vectors on the water, and the velocity of the bank. true_m3_s: the known discharge."""

    water: Vectors
    bank: BankVelocity
    known: KnownWater
    discharge: Discharge
    true_m3_s: float

    @property
    def true_m_s(self) -> FloatArray:
        """Known speed (n,) at the places of the vectors on water, m/s; NaN beyond the picture."""
        velocity_m_s = self.known.velocity_m_s(self.water.position_m)
        return np.asarray(np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1]))

    @property
    def runs(self) -> BoolArray:
        """(n,) vectors that lie where the water is known to run."""
        return np.asarray(self.true_m_s >= RUNS_M_S)

    @property
    def medians_m_s(self) -> tuple[float, float]:
        """Of the measured and of the known speeds there; NaN: there are no vectors."""
        runs = self.runs
        if not runs.any():
            return float("nan"), float("nan")
        return float(np.median(speed_m_s(self.water)[runs])), float(np.median(self.true_m_s[runs]))

    @property
    def bank_m_s(self) -> float:
        """Speed of the bank; NaN: unknown."""
        return float(np.hypot(*self.bank.median_m_s))

    def text(self) -> str:
        """The figures beside the truth, as a table."""
        found, (speed, true) = self.discharge, self.medians_m_s
        title = f"{'the water':<32}{'measured':>14}{'truth':>14}"
        rows = (f"{'median speed, m/s':<32}{speed:14.3f}{true:14.3f}   {self._spread()}",
                f"{'speed of the bank, m/s':<32}{self.bank_m_s:14.4f}{0:14.4f}   "
                f"{self.bank.count} vectors",
                f"{'discharge, m3/s':<32}{found.q_m3_s:14.2f}{self.true_m3_s:14.2f}   95 % between "
                f"{found.low_m3_s:.2f} and {found.high_m3_s:.2f}, {found.shares.measured:.0%} measured")
        return "\n".join([title, *rows])

    def _spread(self) -> str:
        """How far single vectors lie from the truth."""
        runs = self.runs
        if not runs.any():
            return "no vectors"
        error = np.abs(speed_m_s(self.water) - self.true_m_s)[runs]
        return (f"{runs.sum()} vectors, half of them within {np.median(error):.3f}; their own sigma "
                f"{np.median(sigma_speed_m_s(self.water)[runs]):.3f}")


def measure(recorded: Path, known: KnownWater, table: Path, page: Path, section: Path) -> Flow:
    """Measures velocities in the recorded pictures, by the recorded homographies, and the discharge from them.

    table, page, section: the files that are written.

    Raises:
        InputError: the bag holds no pictures or homographies. WorkError: a file cannot be written.
    """
    values: dict[str, Value] = {"gsd_m": known.gsd_m, "orientation": "dynamic_stabilization"}
    with TemporaryDirectory() as folder, bar("velocities") as progress:
        velocities = velocity(Job(recorded, Path(folder) / "velocity.mcap", values, image_topic=RAW,
                                  velocity_values=values, csv=table, html=page, force=True), progress)
    write_section(section)
    config = DischargeConfig(search_m=_SEARCH_M)
    found = discharge_from_files(DischargeJob(table, section, config)).discharge
    return Flow(velocities.water, velocities.bank, known, found, known.discharge_m3_s(config.alpha))
