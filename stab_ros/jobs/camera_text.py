"""The tables that `stab-ros camera` prints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.camera_fit import CameraFit
from stab_ros.georeferencing.plane_fit import PlaneFit
from stab_ros.io.camera_file import CameraFile
from stab_ros.jobs.camera import FittedCamera


def as_text(fitted: FittedCamera) -> str:
    """Residuals of each point, then the parameters with their standard deviations."""
    fit = fitted.fit
    parts = [_points(fitted), _summary(fit)]
    parts.append(_parameters(fit) if isinstance(fit, CameraFit) else _homography(fit))
    return "\n\n".join([*parts, *_place(fitted.file)])


def _place(file: CameraFile | None) -> list[str]:
    """Where the camera is in the reference system of the survey."""
    if file is None or file.frame is None or file.pose is None:
        return []
    x, y, z = file.frame.to_crs(file.crs, file.pose.position_m[None])[0]
    digits = 8 if abs(x) <= 180 and abs(y) <= 90 else 3
    return [f"the camera in {file.crs}: {x:.{digits}f}, {y:.{digits}f}, {z:.3f}; origin of the map: "
            f"{file.frame.latitude_deg:.8f}, {file.frame.longitude_deg:.8f} (latitude, longitude), height 0"]


def _points(fitted: FittedCamera) -> str:
    fit, (left_px, left_m) = fitted.fit, fitted.left_out
    rows = [["point", "x", "y", "residual px", "residual m", "left out px", "left out m", ""]]
    columns = [_length(values) for values in (fit.residuals_px, fit.residuals_m, left_px, left_m)]
    for i, name in enumerate(fit.points.names):
        x, y = fit.points.image_px[i]
        cells = [_cell(column[i], digits) for column, digits in zip(columns, (2, 3, 2, 3), strict=True)]
        rows.append([name, f"{x:.1f}", f"{y:.1f}", *cells, "" if fit.used[i] else "wrong"])
    return _table(rows)


def _summary(fit: CameraFit | PlaneFit) -> str:
    of = f"{int(fit.used.sum())} of {len(fit.points)} points"
    aic = f", AIC {fit.aic:.2f}" if isinstance(fit, CameraFit) else ""
    noise = fit.solution.noise
    known = "given" if noise.image_px else "from the residuals" if fit.solution.noise_is_measured else "assumed"
    base = 1.0 if noise.image_px is None else noise.image_px
    sigma_px = base * float(np.sqrt(fit.solution.variance_factor))
    return (f"RMSE {fit.rmse_px:.3g} px, {fit.rmse_m:.3g} m ({of}){aic}; noise of a pixel coordinate {sigma_px:.2g} px "
            f"({known})")


def _parameters(fit: CameraFit) -> str:
    position, K = fit.view.pose.position_m, fit.view.camera.K
    angles = np.degrees(fit.view.pose.angles_rad)
    sigma = fit.sigmas
    rows = [["parameter", "value", "sigma"]]
    rows += [[name, f"{value:.3f}", _cell(sigma.get(name, 0.0), 3) if name in sigma else "given"]
             for name, value in zip(("east_m", "north_m", "up_m"), position, strict=True)]
    rows += [[f"{name}, deg", f"{value:.3f}", ""]
             for name, value in zip(("yaw", "pitch", "roll"), angles, strict=True)]
    rows += [[f"rotation about {axis}, deg", "", f"{np.degrees(sigma[f'about_{axis}_rad']):.4f}"]
             for axis in ("east", "north", "up")]
    focals = {0: [("fx_px", K[0, 0]), ("fy_px", K[1, 1])], 1: [("f_px", K[0, 0])],
              2: [("fx_px", K[0, 0]), ("fy_px", K[1, 1])]}[fit.unknowns.focals]
    rows += [[name, f"{value:.2f}", _cell(sigma[name], 2) if name in sigma else "given"] for name, value in focals]
    if fit.unknowns.k1:
        rows.append(["k1", f"{fit.view.camera.D[0]:.5f}", f"{sigma['k1']:.5f}"])
    return _table(rows)


def _homography(fit: PlaneFit) -> str:
    sigma = np.sqrt(np.diag(fit.covariance))
    rows = [["map_H_image", "value", "sigma"]]
    rows += [[f"h{i // 3}{i % 3}", f"{value:.9g}", f"{one:.2g}"]
             for i, (value, one) in enumerate(zip(fit.map_H_image.ravel()[:8], sigma, strict=True))]
    return _table(rows)


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join([row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in
                                                           zip(row[1:], widths[1:], strict=True))]).rstrip()
                     for row in rows)
