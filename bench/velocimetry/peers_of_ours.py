"""A process that measures with stab_ros, as the processes of the peers do. See peers_child.py.

settings: {"method": "particles", "lspiv" or "stiv", and its own}; water.png tells water from ground, as the static map
of the tracker does for the command. stiv measures along the lines of lines.json, [[[x, y], [x, y]], ...] in px.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from peers_child import serve

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # this checkout, whichever is installed

from stab_ros.core.geometry import apply
from stab_ros.core.memory import keep_freed_memory
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography
from stab_ros.velocimetry.lspiv import Lspiv
from stab_ros.velocimetry.lspiv_settings import LspivConfig
from stab_ros.velocimetry.method import Method
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.shore import off_ground
from stab_ros.velocimetry.stiv import Stiv
from stab_ros.velocimetry.stiv_settings import StivConfig
from stab_ros.velocimetry.vectors import Vectors
from stab_ros.velocimetry.zone import Zone


def measure(frames: Gray, question: Mapping[str, Any]) -> FloatArray:
    """(N, 5) as peers_child.py."""
    plane_H_image = np.diag([question["gsd_m"], -question["gsd_m"], 1.0])
    method = _method(dict(question["settings"]), plane_H_image, Path(question["frames"]))
    found = [method.add(PlacedFrame(round(k / question["fps"] * 1e9), gray, plane_H_image, np.zeros((8, 8))))
             for k, gray in enumerate(frames)]
    parts = [_rows(vectors, method, plane_H_image) for vectors in (*found, method.finish()) if vectors is not None]
    return np.concatenate(parts) if parts else np.zeros((0, 5))


def _method(settings: dict[str, Any], plane_H_image: Homography, folder: Path) -> Method:
    water: BoolArray = _read(str(folder / "water.png")) > 0
    make: Mapping[str, Callable[[], Method]] = {
        "particles": lambda: _particles(VelocityConfig(**settings), water, plane_H_image),
        "lspiv": lambda: Lspiv(LspivConfig(**settings), water=Zone(plane_H_image, water).outlines()),
        "stiv": lambda: Stiv(StivConfig(**settings), _lines(folder, plane_H_image)),
    }
    return make[settings.pop("method")]()


def _particles(config: VelocityConfig, water: BoolArray, plane_H_image: Homography) -> Particles:
    return Particles(config, PlaneMask(off_ground(~water, config.block_px), np.linalg.inv(plane_H_image)))


def _lines(folder: Path, plane_H_image: Homography) -> list[FloatArray]:
    lines = json.loads((folder / "lines.json").read_text(encoding="utf-8"))
    return [apply(plane_H_image, np.array(line, float)) for line in lines]


def _rows(vectors: Vectors, method: Method, plane_H_image: Homography) -> FloatArray:
    """Particles go a way, windows and lines stay where they are."""
    goes = isinstance(method, Particles)
    place_px = apply(np.linalg.inv(plane_H_image), vectors.start_m if goes else vectors.position_m)
    return np.column_stack([place_px, vectors.velocity_m_s, vectors.dt_s if goes else np.zeros(len(vectors))])


def _read(path: str) -> Gray:
    return np.asarray(cv2.imread(path, cv2.IMREAD_GRAYSCALE), np.uint8)


if __name__ == "__main__":
    keep_freed_memory()
    cv2.setNumThreads(1)
    serve("ours", _read, measure)
