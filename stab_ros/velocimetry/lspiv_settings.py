"""The settings of LSPIV."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.imaging.warp import INTERPOLATION

BLOCKS = 4  # of a window's side: the parts by which its covariance is told


@dataclass(frozen=True)
class LspivConfig(Checked):
    """How velocities are measured by ensemble correlation; lengths and speeds in the unit of the plane.

    Raises:
        ConfigError: a value has the wrong type or is out of range, or values contradict each other.
    """

    interval_s: float = setting(2.0, "Seconds over which each velocity is the mean", 0.05, 600.0)
    resolution_m: float = setting(
        0.0, "Side of a pixel of the grid on the water plane; 0: the median ground sampling distance, coarser for more "
        "than 2.2 million pixels", 0.0, 1000.0)
    window_px: int = setting(
        48, "Side of the interrogation windows in pixels of the grid, a multiple of 4", 16, 256)
    windows_per_side: int = setting(
        2, "Number of windows that begin within the side of one: 1 (side by side), 2 (half overlapping) or 4", 1, 4)
    max_speed_m_s: float = setting(
        0.0, "Highest speed that is sought; 0: a quarter of the window from frame to frame, up to a whole one where "
        "the water goes farther", 0.0, 100000.0)
    gap_s: float = setting(
        0.0, "Longest time between the pictures of a pair, for slow water; 0: a quarter of interval_s", 0.0, 60.0)
    pairs: int = setting(24, "Largest number of pairs of pictures of an interval that are correlated", 4, 1000)
    min_correlation: float = setting(0.2, "Mean correlation coefficient below which there is no vector", 0.0, 1.0)
    min_peak_ratio: float = setting(
        1.2, "Ratio of the highest peak of the search to the second one below which there is no vector", 1.0, 100.0)
    interpolation: str = setting("cubic", "Interpolation of the pictures on the grid", choices=tuple(INTERPOLATION))
    clock_sigma: float = setting(1e-4, "Relative standard deviation of the rate of the clock of the stamps", 0.0, 0.1)
    stamp_sigma_s: float = setting(0.0, "Standard deviation of a stamp in seconds", 0.0, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window_px % BLOCKS:
            raise ConfigError(f"window_px: {self.window_px} must be a multiple of {BLOCKS}")
        if BLOCKS % self.windows_per_side:
            raise ConfigError(f"windows_per_side: {self.windows_per_side} must be 1, 2 or 4")
