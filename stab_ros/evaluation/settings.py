"""The settings of the evaluator: what is measured, and from which value on it is reported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting

NamedPoint: TypeAlias = tuple[str, float, float]  # name, x and y in reference px


@dataclass(frozen=True)
class EvaluatorConfig(Checked):
    """What is measured, and from where on it is reported as a problem."""

    points: int = setting(12, "verification points that are chosen in the reference", 1, 100)
    window_px: int = setting(31, "width of the RMSD windows, px, odd; 0: chosen by R^2 of d(RMSD)", 0, 201)
    rmse_every: int = setting(10, "RMSE of homologous points and velocity field: on the frame after the reference and "
                              "on every so many-th", 1, 100000)
    svf_columns: int = setting(4, "sub-regions of the velocity field beside each other", 1, 50)
    svf_rows: int = setting(3, "sub-regions of the velocity field above each other", 1, 50)
    gsd_m: float = setting(0.0, "ground sampling distance, m a pixel; 0: unknown, nothing is told in metres", 0.0, 1e3)
    fps: float = setting(0.0, "frames per second for velocities; 0: from the stamps", 0.0, 1e4)
    displacement_warn_px: float = setting(0.5, "displacement from which a frame is WARN, px", 0.0, 1e3)
    displacement_error_px: float = setting(2.0, "displacement from which a frame is ERROR, px", 0.0, 1e3)
    rmse_warn_px: float = setting(0.5, "RMSE of homologous points from which a frame is WARN, px", 0.0, 1e3)
    rmse_error_px: float = setting(2.0, "RMSE of homologous points from which a frame is ERROR, px", 0.0, 1e3)
    brightness_warn: float = setting(0.03, "relative change of brightness from which a frame is WARN", 0.0, 10.0)
    frozen_frames: int = setting(3, "repeated pictures in a row from which the stream counts as frozen", 1, 100000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window_px and not (self.window_px % 2 and self.window_px >= 5):
            raise ConfigError(f"window_px: {self.window_px} must be odd and at least 5, or 0 to have it chosen")
        for name in ("displacement", "rmse"):
            warn, error = (getattr(self, f"{name}_{level}_px") for level in ("warn", "error"))
            if warn > error:
                raise ConfigError(f"{name}_warn_px: {warn:g} must not lie above {name}_error_px, which is {error:g}")
