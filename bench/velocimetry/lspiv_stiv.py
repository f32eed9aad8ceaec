"""Errors, coverage and time of lspiv and stiv on rendered textures, beside OpenPIV on the same frames.

    PYTHONPATH=.:test/helpers .venv/bin/python bench/velocimetry/lspiv_stiv.py [--openpiv PYTHON] [--seeds 3]

PYTHON: that of an environment in which OpenPIV (GPL-3) is installed; it runs as a process of its own.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import process_time

import numpy as np
from moving_texture_lspiv import MovingTexture, shear, uniform

from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.lspiv import Lspiv
from stab_ros.velocimetry.lspiv_settings import LspivConfig
from stab_ros.velocimetry.method import Method
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.stiv import Stiv
from stab_ros.velocimetry.stiv_settings import StivConfig
from stab_ros.velocimetry.vectors import Vectors

FIRST_SEED = 1000  # constants were chosen on seeds below 100
FRAMES, SIZE, WINDOW_PX = 26, (208, 160), 48
METHODS = {"lspiv": 2, "stiv": 1}  # components that are measured
HEAD = ("scene", "method", "vectors", "median error mm/s", "within 2 sigma %", "median error / sigma", "CPU ms a frame")


def scenes(seed: int, size: tuple[int, int]) -> Mapping[str, MovingTexture]:
    """By name; a pixel is 20 mm, 25 frames/s."""
    return {
        "0.12 m/s": MovingTexture(uniform(0.12), size, seed=seed),
        "0.4 m/s, noise 8": MovingTexture(uniform(0.4), size, noise=8.0, seed=seed),
        "2 m/s": MovingTexture(uniform(2.0), size, seed=seed),
        "shear 0.15 1/s": MovingTexture(shear(0.2, 0.15), size, seed=seed),
        "texture renewed in 1 s": MovingTexture(uniform(0.4), size, renewal_s=1.0, seed=seed),
        "camera shakes 3 px, known to 0.1": MovingTexture(uniform(0.4), size, shake_px=3.0, sigma_px=0.1, seed=seed),
        "flicker 10 %": MovingTexture(uniform(0.4), size, flicker=0.1, seed=seed),
    }


def lines(size: tuple[int, int], gsd: float) -> list[FloatArray]:
    """Along the flow, one each 8 px."""
    right, top = size[0] * gsd, size[1] * gsd
    return [np.array([[0.08 * right, y], [0.92 * right, y]]) for y in np.arange(8 * gsd, top - 8 * gsd, 8 * gsd)]


def measured(method: Method, frames: Sequence[PlacedFrame]) -> tuple[Vectors, float]:
    """All vectors, and the processor time of a frame, ms."""
    start_s = process_time()
    found = [vectors for vectors in map(method.add, frames) if vectors is not None]
    return found[0], (process_time() - start_s) * 1e3 / len(frames)


def ours(scene: MovingTexture, frames: Sequence[PlacedFrame], components: int) -> tuple[FloatArray, FloatArray, float]:
    """Errors and sigmas, m/s, of all components; lspiv has two, stiv the one along the line."""
    interval_s = (len(frames) - 1) / scene.fps
    method: Method = (  # the clock of the scenes is exact
        Lspiv(LspivConfig(interval_s=interval_s, window_px=WINDOW_PX, clock_sigma=0.0)) if components == 2 else
        Stiv(StivConfig(interval_s=interval_s, clock_sigma=0.0), lines(scene.size, scene.gsd)))
    vectors, ms = measured(method, frames)
    along = scene.flow(vectors.position_m[:, 1])
    error = vectors.velocity_m_s - np.stack([along, np.zeros_like(along)], axis=1)
    sigma = np.sqrt(np.diagonal(vectors.total_covariance, axis1=1, axis2=2))
    return error[:, :components], sigma[:, :components], ms


def theirs(python: str, scene: MovingTexture, frames: Sequence[PlacedFrame]) -> tuple[FloatArray, float]:
    """Errors (N, 2), m/s, of OpenPIV's vectors on the same pictures, and ms a frame; its y is upwards as ours."""
    gap = max(int(WINDOW_PX / 4 / max(float(scene.flow(np.ones(1))[0]) / scene.gsd / scene.fps, 0.1)), 1)
    gap = min(gap, (len(frames) - 1) // 4)
    with tempfile.TemporaryDirectory() as folder:
        given, answered = Path(folder) / "frames.npz", Path(folder) / "found.npz"
        np.savez(given, frames=np.stack([frame.gray for frame in frames]), gap=gap, window=WINDOW_PX)
        script = Path(__file__).with_name("lspiv_openpiv.py")
        subprocess.run([python, str(script), str(given), str(answered)], check=True, env={}, capture_output=True)
        found = np.load(answered)
        y, u, v = (found[name].ravel() for name in "yuv")
        ms = float(found["ms"][1])
    known = np.isfinite(u) & np.isfinite(v)
    per_px = scene.gsd * scene.fps / gap
    place_y = scene.gsd * (scene.size[1] - y[known])
    error = np.stack([u[known] * per_px - scene.flow(place_y), v[known] * per_px], axis=1)
    return error, ms


def row(name: str, method: str, errors: Sequence[FloatArray], sigmas: Sequence[FloatArray], ms: float) -> str:
    """A line of the table; errors and sigmas of each seed."""
    error = np.concatenate(errors)
    length = float(np.median(np.linalg.norm(error, axis=1))) * 1e3
    cells = [name, method, f"{len(error) / len(errors):.0f}", f"{length:.2f}"]
    if sigmas:
        ratio = np.abs(error / np.concatenate(sigmas)).ravel()
        cells += [f"{100 * np.mean(ratio < 2):.0f}", f"{np.median(ratio) / 0.6745:.2f}"]
    else:
        cells += ["-", "-"]
    return f"| {' | '.join([*cells, f'{ms:.0f}'])} |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--openpiv", default="", help="Python of an environment with OpenPIV")
    parser.add_argument("--seeds", type=int, default=3, help="number of renderings of each scene")
    parser.add_argument("--size", nargs=2, type=int, default=SIZE, help="width and height of the pictures")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    arguments = parser.parse_args()
    size = arguments.size[0], arguments.size[1]
    print(f"| {' | '.join(HEAD)} |\n|{':--|' * 2}{'--:|' * 5}", flush=True)
    for name in scenes(0, size):
        of_seeds = [scenes(FIRST_SEED + k, size)[name] for k in range(arguments.seeds)]
        frames = [scene.frames(FRAMES) for scene in of_seeds]
        for method in arguments.methods:
            components = METHODS[method]
            if components == 1 and name.startswith("0.12"):
                continue  # a second is too short for stiv: the texture goes 3 of its sizes
            results = [ours(scene, seen, components) for scene, seen in zip(of_seeds, frames, strict=True)]
            print(row(name, method, [r[0] for r in results], [r[1] for r in results],
                      float(np.mean([r[2] for r in results]))), flush=True)
        if arguments.openpiv and "shakes" not in name:
            answers = [theirs(arguments.openpiv, scene, seen) for scene, seen in zip(of_seeds, frames, strict=True)]
            ms = float(np.mean([answer[1] for answer in answers]))
            print(row(name, "OpenPIV", [answer[0] for answer in answers], [], ms), flush=True)


if __name__ == "__main__":
    main()
