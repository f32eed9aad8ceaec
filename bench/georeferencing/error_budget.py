"""What an error of the water level, the camera or the clock moves on the water.

    python bench/georeferencing/error_budget.py

Exact geometry, no noise: the same pixels are mapped to the water plane with and without the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

SIZE, FOCAL_PX = (1920, 1080), 1400.0
FLIGHTS = {  # height above the water, m, and pitch, degrees
    "nadir, 46 m": (46.0, 90.0), "45 degrees down, 46 m": (46.0, 45.0), "15 degrees down, 6 m (a bank)": (6.0, 15.0),
}
SPEED_M_S, TURN_RAD_S = 5 / 3.6, math.radians(3)  # of a drone along a reach, and of its gimbal in a gust


@dataclass(frozen=True)
class Setup:
    """Height above the water, m, pitch, degrees, and the errors of what is known of them."""

    height_m: float
    pitch_deg: float
    wse_m: float = 0.0
    turned_deg: float = 0.0
    focal: float = 1.0
    k1: float = 0.0
    late_s: float = 0.0

    def places(self) -> FloatArray:
        """Where a grid of pixels lies on the water, (N, 2), m."""
        turned_rad = math.radians(self.turned_deg) + TURN_RAD_S * self.late_s
        pose = Pose.of_angles(np.array([SPEED_M_S * self.late_s, 0, self.height_m]), 0.0,
                              math.radians(self.pitch_deg) - turned_rad, 0.0)
        K = np.array([[FOCAL_PX * self.focal, 0, 959.5], [0, FOCAL_PX * self.focal, 539.5], [0, 0, 1]])
        view = View(Camera(K, np.array([self.k1, 0, 0, 0]), "plumb_bob", SIZE), pose)
        x, y = np.meshgrid(np.linspace(96, 1823, 9), np.linspace(54, 1025, 9))
        return view.to_plane(np.stack([x.ravel(), y.ravel()], axis=1), self.wse_m)


ERRORS = {
    "water level off by 0.1 m": {"wse_m": 0.1},
    "attitude off by 0.1 degrees": {"turned_deg": 0.1},
    "focal length off by 1 %": {"focal": 1.01},
    "distortion k1 = -0.05 not removed": {"k1": -0.05},
    "clock off by 15 ms (5 km/h, turning by 3 degrees/s)": {"late_s": 0.015},
}


def main() -> None:
    """Prints the median over the picture of the shift, cm, and of the error of lengths, %."""
    print(f"| error | {' | '.join(f'{name}: cm | %' for name in FLIGHTS)} |")
    print(f"| :-- |{' --: | --: |' * len(FLIGHTS)}")
    for error, change in ERRORS.items():
        cells = [cell for flight in FLIGHTS.values() for cell in _cells(Setup(*flight), change)]
        print(f"| {error} | {' | '.join(cells)} |")


def _cells(right: Setup, change: dict[str, float]) -> tuple[str, str]:
    true, off = right.places(), replace(right, **change).places()
    seen = np.isfinite(true + off).all(axis=1)
    shift_m = np.linalg.norm((off - true)[seen], axis=1)
    lengths = [np.linalg.norm(np.diff(places.reshape(9, 9, 2), axis=1), axis=2) for places in (true, off)]
    scale = np.nanmedian(lengths[1] / lengths[0]) - 1
    return f"{100 * np.median(shift_m):.1f}", f"{100 * scale:+.2f}"


if __name__ == "__main__":
    main()
