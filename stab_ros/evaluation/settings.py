"""The settings of the evaluator: what is measured, and from which value on it is reported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting

NamedPoint: TypeAlias = tuple[str, float, float]  # name, x and y in reference px


@dataclass(frozen=True)
class EvaluatorConfig(Checked):
    """What an `Evaluator` measures, and from which value on it is a problem; each field carries its range and meaning.

    Raises:
        ConfigError: a value has the wrong type or is out of range, or a warning threshold lies above the one for an
            error.
    """

    points: int = setting(12, "Number of verification points chosen in the reference frame", 1, 100)
    window_px: int = setting(
        31, "Side length of the RMSD windows in pixels, odd; 0: chosen by R^2 of the d(RMSD) fit", 0, 201)
    rmse_every: int = setting(
        10, "Interval in frames between measurements of the RMSE of homologous points and of the velocity field; the "
        "frame after the reference is always measured", 1, 100000)
    svf_columns: int = setting(4, "Number of columns of sub-regions in the velocity field", 1, 50)
    svf_rows: int = setting(3, "Number of rows of sub-regions in the velocity field", 1, 50)
    gsd_m: float = setting(
        0.0, "Ground sampling distance in metres per pixel; 0: unknown, no results in metres", 0.0, 1e3)
    fps: float = setting(
        0.0, "Frame rate used for velocities, in frames per second; 0: taken from the stamps", 0.0, 1e4)
    displacement_warn_px: float = setting(
        0.5, "Displacement in pixels at which a frame is reported as WARN", 0.0, 1e3)
    displacement_error_px: float = setting(
        2.0, "Displacement in pixels at which a frame is reported as ERROR", 0.0, 1e3)
    rmse_warn_px: float = setting(
        0.5, "RMSE of homologous points in pixels at which a frame is reported as WARN", 0.0, 1e3)
    rmse_error_px: float = setting(
        2.0, "RMSE of homologous points in pixels at which a frame is reported as ERROR", 0.0, 1e3)
    brightness_warn: float = setting(
        0.03, "Relative change of brightness at which a frame is reported as WARN", 0.0, 10.0)
    frozen_frames: int = setting(
        3, "Number of consecutive identical images at which the stream is reported as frozen", 1, 100000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window_px and not (self.window_px % 2 and self.window_px >= 5):
            raise ConfigError(f"window_px: {self.window_px} must be odd and at least 5, or 0 to have it chosen")
        for name in ("displacement", "rmse"):
            warn, error = (getattr(self, f"{name}_{level}_px") for level in ("warn", "error"))
            if warn > error:
                raise ConfigError(f"{name}_warn_px: {warn:g} must not lie above {name}_error_px, which is {error:g}")
