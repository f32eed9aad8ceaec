"""The settings of STIV."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.settings import Checked, setting


@dataclass(frozen=True)
class StivConfig(Checked):
    """How velocities are measured along lines; lengths and speeds in the unit of the plane."""

    interval_s: float = setting(4.0, "Seconds over which each velocity is the mean", 0.2, 600.0)
    resolution_m: float = setting(
        0.0, "Distance of the samples along a line; 0: the median ground sampling distance of the first frame", 0.0,
        1000.0)
    rows: int = setting(3, "Number of parallel rows, one sample apart, whose mean is taken", 1, 51)
    max_speed_m_s: float = setting(
        0.0, "Highest speed that is sought; 0: 16 samples from frame to frame, up to 64 where that fits better", 0.0,
        100000.0)
    min_correlation: float = setting(0.2, "Mean correlation coefficient below which there is no vector", 0.0, 1.0)
    angle_sigma_rad: float = setting(
        0.2, "Standard deviation of the angle of the flow to the lines in radians", 0.0, 1.5)
    clock_sigma: float = setting(1e-4, "Relative standard deviation of the rate of the clock of the stamps", 0.0, 0.1)
    stamp_sigma_s: float = setting(0.0, "Standard deviation of a stamp in seconds", 0.0, 1.0)
