"""Control points that others have published, against the figures they give. Fetch the files; they are not part of this.

    PYTHONPATH=. .venv/bin/python bench/georeferencing/public_points.py --imgraft gcp8902.txt --pyorc dk_cam_config.json

grinsted/ImGRAFT, demos/gcp8902.txt: 28 points of a glacier, camera at a known place, attitude, fx, fy and k1 fitted
(demoengabreen.m: RMSE 5.1 px, AIC 155). Some pixels are written as sums, as 1951+9: the published figures are those of
the first number alone. localdevices/pyorc, examples/geul/dk_cam_config.json: 6 points of a brook, camera calibrated
(4.2 px).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.adjustment import solved
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import KnownPosition, Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.leave_one_out import leave_one_out
from stab_ros.imaging.camera import Camera

IMGRAFT_SIZE, IMGRAFT_PLACE = (4290, 2856), np.array([446722.0, 7396671.0, 770.0])


def told(title: str, fit: CameraFit) -> None:
    """Prints the fit without wrong points, and with all."""
    everything = np.ones(len(fit.points), bool)
    whole = CameraFit(fit.points, solved(fit.solution.problem, everything, fit.solution.noise))
    left_out = np.linalg.norm(leave_one_out(whole)[0], axis=1)
    f = np.diag(fit.view.camera.K)[:2]
    print(f"{title}\n  all points: RMSE {whole.rmse_px:.4f} px, {whole.rmse_m:.3f} m, AIC {whole.aic:.2f}, left out "
          f"{np.sqrt(np.mean(left_out**2)):.2f} px\n  wrong: {', '.join(fit.wrong) or 'none'}; without them RMSE "
          f"{fit.rmse_px:.3f} px, AIC {fit.aic:.2f}; fx {f[0]:.1f}, fy {f[1]:.1f}, k1 {fit.view.camera.D[0]:.4f}; "
          f"at {np.round(fit.view.pose.position_m, 2)}")
    for warning in fit.warnings:
        print(f"  warning: {warning}")


def imgraft(path: Path) -> None:
    """Attitude, fx, fy, k1 of the demo, with each reading of the sums, and with the place free."""
    lines = [line.split("%")[0].split() for line in path.read_text(encoding="utf-8").splitlines()]
    readings: dict[str, Callable[[str], float]] = {
        "first number": lambda word: float(word.split("+")[0]),
        "sum": lambda word: sum(map(float, word.split("+")))}
    for reading, number in readings.items():
        rows: FloatArray = np.array([[number(word) for word in line] for line in lines if line])
        origin = np.append(rows[0, :2], 0)
        points = ControlPoints(tuple(str(i + 1) for i in range(len(rows))), rows[:, 3:] - 1, rows[:, :3] - origin)
        for name, known in (("place known", KnownPosition(IMGRAFT_PLACE - origin)), ("place free", None)):
            fit = fit_camera(points, IMGRAFT_SIZE, Unknowns(focals=2, k1=True), known=known)
            told(f"ImGRAFT, {reading}, {name}", fit)


def pyorc(path: Path) -> None:
    """The pose of the calibrated camera, and the attempt to fit its focal length too."""
    config = json.loads(path.read_text(encoding="utf-8"))
    size = (config["width"], config["height"])
    camera = Camera(np.array(config["camera_matrix"]), np.array(config["dist_coeffs"]).ravel(), "plumb_bob", size)
    places = np.array(config["gcps"]["dst"])
    names = tuple(f"G{i + 1}" for i in range(len(places)))
    points = ControlPoints(names, np.array(config["gcps"]["src"], float), places - np.append(places[0, :2], 0))
    told("pyorc, Geul, camera calibrated", fit_pose(points, camera))
    told("pyorc, Geul, focal length fitted", fit_camera(points, size, camera=camera))


def main() -> None:
    """Prints what the files give."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--imgraft", type=Path)
    parser.add_argument("--pyorc", type=Path)
    options = parser.parse_args()
    if options.imgraft:
        imgraft(options.imgraft)
    if options.pyorc:
        pyorc(options.pyorc)


if __name__ == "__main__":
    main()
