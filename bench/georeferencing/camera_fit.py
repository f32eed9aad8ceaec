"""Whether the sigmas of a camera fit are true, and whether a wrong control point is found: new draws of 8 points.

    PYTHONPATH=.:bench:test/helpers .venv/bin/python bench/georeferencing/camera_fit.py --draws 1000

Each draw has a new view (pitch 29 to 90 degrees, any yaw), relief of 6 m, points anywhere in the picture and new noise
of 0.3 px; the fit starts from nothing. Shares are of |error| <= 3 sigma, for each parameter; a normal distribution has
99.7 %. A draw takes 0.2 s of one core, so 1000 of each kind take half an hour; `--only` chooses kinds by a word, and
`--near` starts at the truth, which is six times faster and finds the same minimum. `--first` is the seed to begin with.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from control_scene import Scene, moved
from tables import Table
from tqdm import tqdm

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.imaging.view import View

SIZES = ((1920, 1080), (4096, 2160))
POINTS, NOISE_PX, MOVED_M = 8, 0.3, 0.5
Fit = Callable[[ControlPoints, View], CameraFit]


@dataclass(frozen=True)
class Kind:
    """What is fitted. k1: of the lens, which is fitted too where it is not 0. noise: given, or from the residuals."""

    name: str
    noise: PointNoise
    k1: float = 0.0
    known: bool = False

    def fit(self, points: ControlPoints, view: View, near: View | None = None) -> CameraFit:
        if self.known:
            return fit_pose(points, view.camera, noise=self.noise, near=near)
        return fit_camera(points, view.camera.size, Unknowns(k1=self.k1 != 0), noise=self.noise, near=near)


GIVEN, MEASURED = PointNoise(NOISE_PX), PointNoise()
KINDS = (Kind("pose, f; noise given", GIVEN), Kind("pose, f; noise from residuals", MEASURED),
         Kind("pose, f, k1; noise given", GIVEN, -0.05), Kind("pose, f, k1; noise from residuals", MEASURED, -0.05),
         Kind("pose of a known camera; noise given", GIVEN, known=True),
         Kind("pose of a known camera; noise from residuals", MEASURED, known=True))


@dataclass
class Tally:
    """ratios: |error| / sigma of the parameters of each fit. named: draws with a moved point by what was named."""

    ratios: list[FloatArray] = field(default_factory=list)
    refused: int = 0
    accused: int = 0
    named: dict[str, int] = field(default_factory=lambda: {"alone": 0, "with others": 0, "no": 0, "refused": 0})


def errors_of(fit: CameraFit, truth: View) -> FloatArray:
    """Errors of the parameters in the order of `Unknowns.names`."""
    pose, names = fit.view.pose, fit.unknowns.names
    turn = pose.cam_R_map.T @ truth.pose.cam_R_map  # Exp(w): from the fitted map_R_cam to the true one, transposed
    w = -np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    errors = [*(pose.position_m - truth.pose.position_m), *w]
    if "f_px" in names:
        errors.append(fit.view.camera.K[0, 0] - truth.camera.K[0, 0])
    if "k1" in names:
        errors.append(fit.view.camera.D[0] - truth.camera.D[0])
    return np.array(errors)


def drawn(kind: Kind, size: tuple[int, int], rng: np.random.Generator) -> tuple[ControlPoints, View]:
    """Control points of a new view."""
    scene = Scene(size, float(rng.uniform(0.5, np.pi / 2)), 6.0, kind.k1, 46.0, float(rng.uniform(-np.pi, np.pi)))
    return scene.points(POINTS, NOISE_PX, rng), scene.view


def coverage(kind: Kind, size: tuple[int, int], seeds: range, tally: Tally, near: bool) -> None:
    """Fits right points; near: from the true view on."""
    for seed in tqdm(seeds, kind.name, leave=False, disable=None):
        points, view = drawn(kind, size, np.random.default_rng(seed))
        try:
            fit = kind.fit(points, view, view if near else None)
        except InputError:
            tally.refused += 1
            continue
        tally.accused += bool(fit.wrong)
        tally.ratios.append(np.abs(errors_of(fit, view)) / list(fit.sigmas.values()))


def naming(kind: Kind, size: tuple[int, int], draws: int, tally: Tally) -> None:
    """Moves one point on the ground, in any direction."""
    for seed in tqdm(range(draws), f"{kind.name}, one moved", leave=False, disable=None):
        rng = np.random.default_rng(10**6 + seed)
        points, view = drawn(kind, size, rng)
        name, angle = str(rng.choice(points.names)), rng.uniform(0, 2 * np.pi)
        try:
            wrong = kind.fit(moved(points, name, MOVED_M * np.cos(angle), MOVED_M * np.sin(angle)), view).wrong
        except InputError:
            tally.named["refused"] += 1
            continue
        tally.named["alone" if wrong == (name,) else "with others" if name in wrong else "no"] += 1


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--moved", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="seed of the first draw")
    parser.add_argument("--near", action="store_true", help="start at the true view")
    parser.add_argument("--only", default="", help="kinds with this in their name")
    options = parser.parse_args()
    shares, named = [], []
    for size in SIZES:
        for kind in (kind for kind in KINDS if options.only in kind.name):
            tally = Tally()
            seeds = range(options.first, options.first + options.draws)
            coverage(kind, size, seeds, tally, options.near)
            naming(kind, size, options.moved, tally)
            inside = 100 * (np.array(tally.ratios) <= 3).mean(axis=0)
            cells = [f"{share:.1f}" for share in inside] + [""] * (8 - len(inside))
            shares.append([f"{size[0]}x{size[1]}, {kind.name}", *cells, str(tally.refused), str(tally.accused)])
            named.append([f"{size[0]}x{size[1]}, {kind.name}", *map(str, tally.named.values())])
    head = ["|error| <= 3 sigma, %", "east", "north", "up", "about e", "about n", "about u", "f", "k1", "refused",
            "accused"]
    print(Table(f"{options.draws} draws of {POINTS} points, {NOISE_PX} px", head, shares,
                "accused: draws in which a right point was called wrong").text())
    print()
    if options.moved:
        print(Table(f"{options.moved} draws, one point moved by {MOVED_M} m on the ground",
                    ["named", "alone", "with others", "no", "refused"], named).text())


if __name__ == "__main__":
    main()
