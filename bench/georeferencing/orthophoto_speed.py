"""Orthophotos through a lens: processor time by exact tables and as they are made, in turns; and how far places differ.

python bench/georeferencing/orthophoto_speed.py [TURNS]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from stab_ros.core.types import Homography, Image
from stab_ros.georeferencing.orthophoto import Orthophotos
from stab_ros.imaging.camera import Camera

_SIZE, _GRID = (1920, 1080), (1990, 1120)
_LENSES = {"k1 -0.05, 65 degrees wide": (1500.0, -0.05), "k1 -0.3, 88 degrees wide": (1000.0, -0.3)}
_VIEWS = {"north up": (0.02, 1e-6), "turned by 46 degrees": (0.8, 1e-4), "oblique, turned by 115": (2.0, 6e-4)}
_HEAD = ("lens", "view", "exact tables, ms", "as made, ms", "ratio", "largest difference, grey levels")
_NOTE = ("1920x1080 bgr8 to 1990x1120: medians of {} turns of processor time, of all threads; each turn shows another "
         "place, so that no table serves twice. OpenCV {}.")


def main(turns: int) -> None:
    """All lenses and views, one after the other."""
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (*_SIZE[::-1], 3)).astype(np.uint8), (0, 0), 2)
    print(f"| {' | '.join(_HEAD)} |\n|---|---|--:|--:|--:|--:|")
    for lens, optics in _LENSES.items():
        for view, seen in _VIEWS.items():
            print(f"| {lens} | {view} | {_compared(image, _camera(*optics), *seen, turns)} |", flush=True)
    print(f"\n{_NOTE.format(turns, cv2.__version__)}")


def _camera(focal_px: float, k1: float) -> Camera:
    K = np.array([[focal_px, 0, (_SIZE[0] - 1) / 2], [0, focal_px, (_SIZE[1] - 1) / 2], [0, 0, 1]])
    return Camera(K, np.array([k1, 0.1 * abs(k1), 0, 0, 0]), "plumb_bob", _SIZE)


def _ortho_H_image(turn_rad: float, tilt: float, shift_px: float) -> Homography:
    """Grid and image centred on each other; the depth is positive there."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    to_grid, to_image = np.eye(3), np.eye(3)
    to_grid[:2, 2], to_image[:2, 2] = np.array(_GRID) / 2 + shift_px, -np.array(_SIZE) / 2
    return np.asarray(to_grid @ np.array([[c, -s, 0], [s, c, 0], [tilt, 0, 1]]) @ to_image)


def _compared(image: Image, camera: Camera, turn_rad: float, tilt: float, turns: int) -> str:
    photos, spent_s, worst = Orthophotos(camera, "linear"), list[tuple[float, float]](), 0
    for turn in range(turns + 1):  # the first one warms up
        H = _ortho_H_image(turn_rad, tilt, 0.37 * turn)
        exact_s, exact = _timed(partial(camera.rectify, image, H, _GRID, cv2.INTER_LINEAR))
        made_s, made = _timed(partial(photos.make, image, H, _GRID))
        worst = max(worst, int(np.abs(exact.astype(int) - made).max()))
        spent_s.append((exact_s, made_s))
    exact_ms, made_ms = (1e3 * np.median([pair[k] for pair in spent_s[1:]]) for k in range(2))
    ratio = float(np.median([exact / made for exact, made in spent_s[1:]]))
    return f"{exact_ms:.1f} | {made_ms:.1f} | {ratio:.2f} | {worst}"


def _timed(work: Callable[[], Image]) -> tuple[float, Image]:
    start_s = time.process_time()
    image = work()
    return time.process_time() - start_s, image


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 15)
