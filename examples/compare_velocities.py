"""Tables of velocities beside a known flow: `stab-ros velocity --csv`, openpiv_of_bag.py and pyorc_of_video.py.

    python compare_velocities.py bags/sample_water.csv 0.06 960 540 V.csv V_openpiv.csv

The first file holds the truth on a grid, in pixels of the reference: x_px, y_px, vx_m_s, vy_m_s (y down). Then come the
ground sampling distance, m a pixel, and the size of the reference. Vectors count where the known water runs at 0.3 m/s
or more.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

_RUNS_M_S = 0.3  # slower water is the shore's, where windows hold both
Array = NDArray[Any]


def table(path: Path) -> dict[str, Array]:
    """Columns of a CSV by their names."""
    names = path.read_text(encoding="utf-8").partition("\n")[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).T, strict=True))


def known_flow(path: Path) -> RegularGridInterpolator:
    """Velocity (n, 2) to the right and down, m/s, at places (n, 2) in px."""
    of = table(path)
    x_px, y_px = np.unique(of["x_px"]), np.unique(of["y_px"])
    grid = np.dstack([of[name].reshape(len(y_px), len(x_px)).T for name in ("vx_m_s", "vy_m_s")])
    return RegularGridInterpolator((x_px, y_px), grid, bounds_error=False)


def vectors(path: Path, gsd_m: float, size: Array) -> tuple[Array, Array]:
    """Places (n, 2) in px and velocities (n, 2) to the right and down, m/s."""
    of = table(path)
    if "x_px" in of:
        return np.column_stack([of["x_px"], of["y_px"]]), np.column_stack([of["vx_m_s"], of["vy_m_s"]])
    # of stab-ros: a map that begins below the middle of the reference, y up; the middle of the way
    middle_m = np.column_stack([of["x_start_m"] + of["x_end_m"], -of["y_start_m"] - of["y_end_m"]]) / 2
    return (size - 1) / 2 + middle_m / gsd_m, np.column_stack([of["vx_m_s"], -of["vy_m_s"]])


def main(truth: Path, gsd_m: float, size: Array, files: list[Path]) -> None:
    """Prints a row for each file."""
    flow = known_flow(truth)
    print("| table | vectors | median speed, m/s | known there | median size of error, m/s | 90 % below |")
    print("|:--|--:|--:|--:|--:|--:|")
    for file in files:
        place_px, measured = vectors(file, gsd_m, size)
        known = flow(place_px)
        runs = np.hypot(*known.T) >= _RUNS_M_S
        error = np.hypot(*(measured - known)[runs].T)
        speeds = [np.median(np.hypot(*of[runs].T)) for of in (measured, known)]
        print(f"| {file.name} | {runs.sum()} | {speeds[0]:.3f} | {speeds[1]:.3f} | {np.median(error):.3f} | "
              f"{np.quantile(error, 0.9):.3f} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]), np.array(sys.argv[3:5], int), [Path(name) for name in sys.argv[5:]])
