"""The rivers of the comparison: frames that lie still, at a known scale, whose velocity is known everywhere.

The camera hovers without any motion, so that nothing but velocimetry differs between methods.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.synthetic.camera_path import Motion, Pose
from stab_ros.synthetic.moving_river import RiverFlight
from stab_ros.synthetic.river import preset
from stab_ros.synthetic.river_flows import flow_of
from stab_ros.synthetic.surface import PRESETS

SHORE_PX = 24.0  # of vectors judged, from the shore: half a window of ours
CELL_PX = 24  # of the places that count as covered where a vector lies within a cell
_OUTLIER = 0.2  # of the mean speed
_LINE_PX, _BESIDE_PX = 100, 8  # length of the lines of stiv, and distance between them


@dataclass(frozen=True)
class Scene:
    """A river by its name. duration_s: of the frames."""

    name: str
    river: str
    surface: str
    size: tuple[int, int]
    duration_s: float = 2.0

    def flight(self, seed: int) -> RiverFlight:
        settings = replace(preset(self.river), motion=Motion(Pose(), 0.1))
        frames = round(self.duration_s * settings.fps) + 1
        return RiverFlight(settings, flow_of(settings), PRESETS[self.surface], self.size, frames, seed)


SCENES = (Scene("basento", "basento", "calm", (640, 360)),
          Scene("basento, disturbed", "basento", "disturbed", (640, 360)),
          Scene("kolubara", "kolubara", "calm", (640, 338)))


@dataclass(frozen=True, eq=False)
class Judged:
    """Vectors against the truth.

    Attributes:
        along: (N,) signed errors along the true velocity, mm/s.
        sizes: (N,) of the errors, mm/s.
        mean_mm_s: mean speed of the water.
        covered: share of the places on the water that have a vector near.
    """

    along: FloatArray
    sizes: FloatArray
    mean_mm_s: float
    covered: float

    @staticmethod
    def of_all(parts: list[Judged]) -> Judged:
        return Judged(np.concatenate([one.along for one in parts]), np.concatenate([one.sizes for one in parts]),
                      float(np.mean([one.mean_mm_s for one in parts])), float(np.mean([one.covered for one in parts])))

    def figures(self) -> dict[str, float]:
        """Median, 95th percentile and bias (the mean of what is no outlier) in mm/s; shares in percent."""
        wrong = self.sizes > _OUTLIER * self.mean_mm_s
        median, high = np.quantile(self.sizes, (0.5, 0.95)) if len(self.sizes) else (np.nan, np.nan)
        bias = float(self.along[~wrong].mean()) if not wrong.all() else float("nan")
        share = 100 * float(wrong.mean()) if len(wrong) else float("nan")
        return {"vectors": len(self.sizes), "covered": 100 * self.covered, "median_mm_s": float(median),
                "p95_mm_s": float(high), "bias_mm_s": bias, "outliers": share}


class River:
    """A rendered scene in a folder: frame_000.png and so on, water.png, and lines.json."""

    def __init__(self, scene: Scene, seed: int, folder: Path, frames: int | None = None) -> None:
        """Renders; frames: so many only."""
        self.flight, self.folder = scene.flight(seed), folder
        self.count = min(frames or self.flight.frames, self.flight.frames)
        folder.mkdir(parents=True)
        for k in range(self.count):
            cv2.imwrite(str(folder / f"frame_{k:03d}.png"), self.flight[k].image)
        cv2.imwrite(str(folder / "water.png"), self._water().astype(np.uint8) * 255)
        (folder / "lines.json").write_text(json.dumps(self._lines_px()), encoding="utf-8")

    def question(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """As peers_child.py takes it."""
        return {"frames": str(self.folder), "gsd_m": self.flight.gsd_m, "fps": self.flight.preset.fps,
                "settings": dict(settings), "out": str(self.folder / "found.csv")}

    def judged(self) -> Judged:
        """What the last question found; vectors near the shore and beside the water do not count."""
        lines = (self.folder / "found.csv").read_text(encoding="utf-8").splitlines()[1:]
        rows = np.array([line.split(",") for line in lines], float).reshape(-1, 5)
        rows = rows[self._inside(rows[:, :2])]
        true, places = self._truth(rows), self._places_px()
        error = rows[:, 2:4] - true
        unit = true / np.linalg.norm(true, axis=1, keepdims=True)
        near = np.linalg.norm(places[:, None] - rows[None, :, :2], axis=2).min(axis=1, initial=np.inf) <= CELL_PX
        speed = np.linalg.norm(self._velocity(places), axis=1).mean()
        return Judged(1e3 * np.sum(error * unit, axis=1), 1e3 * np.linalg.norm(error, axis=1), 1e3 * float(speed),
                      float(near.mean()))

    def _truth(self, rows: FloatArray) -> FloatArray:
        """(N, 2) m/s: of the water that was at its place for what goes, at the place for what stays."""
        start_ns = self.flight.stamp_ns(0)
        true = self._velocity(rows[:, :2])
        for dt_s in np.unique(rows[rows[:, 4] > 0, 4]):
            these = rows[:, 4] == dt_s
            places_m = apply(self.flight.map_H_image(0), rows[these, :2])
            true[these] = self.flight.mean_velocity_m_s(places_m, start_ns, start_ns + round(dt_s * 1e9))
        return true

    def _velocity(self, places_px: FloatArray) -> FloatArray:
        return self.flight.velocity_m_s(apply(self.flight.map_H_image(0), places_px), self.flight.stamp_ns(0))

    def _shore_px(self, places_px: FloatArray) -> FloatArray:
        """(N,) from the shore, positive in the water."""
        return self.flight.shore_distance_m(apply(self.flight.map_H_image(0), places_px)) / self.flight.gsd_m

    def _inside(self, places_px: FloatArray) -> BoolArray:
        return np.asarray(self._shore_px(places_px) > SHORE_PX)

    def _water(self) -> BoolArray:
        width, height = self.flight.size
        return (self._shore_px(_grid(width, height, 1, 0)) > 0).reshape(height, width)

    def _places_px(self) -> FloatArray:
        """Where vectors could be: a grid on the water, off the shore and the borders."""
        places = _grid(*self.flight.size, CELL_PX, CELL_PX)
        return places[self._inside(places)]

    def _lines_px(self) -> list[list[list[float]]]:
        """Along the flow, as one would draw them; not over the shore."""
        width, height = self.flight.size
        x, y = np.meshgrid(np.arange(_LINE_PX, width - _LINE_PX + 1, _LINE_PX), np.arange(0, height, _BESIDE_PX))
        middles = np.column_stack([x.ravel(), y.ravel()]).astype(float)
        middles = middles[self._inside(middles)]
        flow = self._velocity(middles) * (1, -1)
        half = _LINE_PX / 2 * flow / np.linalg.norm(flow, axis=1, keepdims=True)
        return [[begin.tolist(), end.tolist()] for begin, end in zip(middles - half, middles + half, strict=True)]


def _grid(width: int, height: int, step: int, border: int) -> FloatArray:
    x, y = np.meshgrid(np.arange(border, width - border, step), np.arange(border, height - border, step))
    return np.column_stack([x.ravel(), y.ravel()]).astype(float)
