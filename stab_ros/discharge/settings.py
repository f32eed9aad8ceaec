"""The settings of a discharge measurement."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.discharge.filling import FILLINGS
from stab_ros.discharge.integration import INTEGRATIONS
from stab_ros.georeferencing.level_doubts import LEVEL_TIMEOUT_S


@dataclass(frozen=True)
class DischargeConfig(Checked):
    """How velocities and a cross-section become a discharge; each field carries its range and meaning.

    Raises:
        ConfigError: a value has the wrong type or is out of range.
    """

    search_m: float = setting(
        0.0, "Search distance in metres around each vertical within which its vectors lie; 0: half the mean distance "
        "of the verticals", 0.0, 1e4)
    verticals: int = setting(
        0, "Number of verticals, spaced evenly over the wet width; 0: the points of the survey", 0, 1000)
    min_vectors: int = setting(
        3, "Number of vectors within the search distance from which a vertical counts as measured", 1, 100000)
    integration: str = setting(
        "mid_section", "How the verticals are added up: mid_section or mean_section", choices=tuple(INTEGRATIONS))
    filling: str = setting(
        "kriging", "How verticals without vectors get a velocity: kriging (v, v / sqrt(h) or v / h goes on along the "
        "section as measured, whichever is likely), froude (v ~ sqrt(h), Le Coz et al. 2008), "
        "froude_linear (Froude number linear over the width), klt_iv (v ~ h, as the released KLT-IV), quadratic or "
        "cubic (polynomials over the width)", choices=tuple(FILLINGS))
    filling_sigma: float = setting(
        0.3, "Relative standard deviation of a filled velocity one width of the river away from the nearest measured "
        "vertical; in proportion nearer by", 0.0, 3.0)
    alpha: float = setting(0.85, "Ratio of depth-averaged to surface velocity", 0.1, 1.5)
    alpha_sigma: float = setting(0.04, "Standard deviation of alpha", 0.0, 0.5)
    wse_sigma_m: float = setting(
        0.02, "Standard deviation in metres of the water surface elevation against the bed", 0.0, 10.0)
    depth_sigma_m: float = setting(0.02, "Standard deviation in metres of each surveyed bed point", 0.0, 10.0)
    draws: int = setting(1000, "Number of Monte Carlo draws", 100, 100000)
    seed: int = setting(0, "Seed of the draws", 0, 2**31 - 1)


@dataclass(frozen=True)
class RunningConfig(Checked):
    """When a running discharge is measured.

    Raises:
        ConfigError: a value has the wrong type or is out of range, or there is more than a window between discharges.
    """

    window_s: float = setting(30.0, "Time in seconds over which vectors are gathered for a discharge", 0.1, 86400.0)
    every_s: float = setting(10.0, "Time in seconds from one discharge to the next, by the stamps", 0.1, 86400.0)
    water_level_timeout_s: float = setting(
        LEVEL_TIMEOUT_S, "Age in seconds of the last water_level above which it is reported as stale: depths and scale "
        "may be wrong", 1.0, 1e6)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.every_s > self.window_s:
            raise ConfigError(f"every_s: {self.every_s:g} must not lie above window_s, which is {self.window_s:g}: "
                              "vectors between two windows would be left out")
