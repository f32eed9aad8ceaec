"""What a high bank does to the homography, and whether that is noticed: flights over ground of two heights."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import cv2
import numpy as np
from effort import Effort
from scenes import SEED
from tables import Section, Table, number
from tqdm import tqdm

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Frame, Homography, Image
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.camera_path import Pose, inverse
from stab_ros.synthetic.flight import Flight, preset

_SIZE, _FRAMES = (960, 540), 60
_SCENES, _HEIGHTS = ("kolubara", "alpine", "basento"), (0.0, 0.02, 0.04, 0.08, 0.12, 0.24)
_POINTS = 400  # of the water, at which the error is taken


class Risen(Flight):
    """A flight over the same ground, which stands higher by `rise`."""

    rise = Pose()

    def image_H_plane(self, index: int) -> Homography:
        return self.camera.image_H_plane(self.pose(index) + self.rise)


class RaisedBank:
    """A flight whose bank above the river in the picture stands `share` of the camera's height above the water."""

    def __init__(self, name: str, share: float) -> None:
        self.flight = Risen(preset(name), _SIZE, _FRAMES, SEED)
        self._high = copy.copy(self.flight)
        self._high.rise = Pose(height_m=-share * self.flight.preset.height_m)
        wet = self.flight.ground.water > 0
        first = np.where(wet.any(axis=0), wet.argmax(axis=0), wet.shape[0] // 2)
        self._bank = ((np.arange(wet.shape[0])[:, None] < first) & ~wet).astype(np.uint8)
        self._where = np.array([[_SIZE[0] / 2, _SIZE[1] / 10]])

    def image(self, index: int) -> Image:
        """(h, w) uint8: what is seen of the bank from where it stands, before the rest."""
        low, high = self.flight[index].image, self._high[index].image
        extent = self.flight.ground.extent
        texel_H_plane = np.diag([1 / extent.texel_m, 1 / extent.texel_m, 1.0])
        texel_H_plane[:2, 2] = -extent.x_m / extent.texel_m, -extent.y_m / extent.texel_m
        image_H_texel = self._high.image_H_plane(index) @ inverse(texel_H_plane)
        seen = cv2.warpPerspective(self._bank, image_H_texel, self.flight.size, flags=cv2.INTER_NEAREST)
        return np.where(seen > 0, high, low)

    def parallax_px(self, index: int) -> float:
        """How far a point of the bank lies from where the plane of the water would put it."""
        low, high = (apply(now @ inverse(before), self._where) for now, before in (
            (self.flight.image_H_plane(index), self.flight.image_H_plane(0)),
            (self._high.image_H_plane(index), self._high.image_H_plane(0))))
        return float(np.hypot(*(high - low)[0]))


@dataclass(frozen=True, eq=False)
class ReliefCourse:
    """error_px: of each frame over the water. sigma_px: likewise. parallax_px: RMS. told_px: at the end, if at all."""

    error_px: FloatArray
    sigma_px: FloatArray
    parallax_px: float
    told_px: float | None


def fly(scene: RaisedBank) -> ReliefCourse:
    """Tracks the flight as the command does."""
    flight, stabilizer, answers = scene.flight, make_stabilizer({}), []
    for index in tqdm(range(len(flight)), flight.preset.name, disable=None, leave=False):
        answers += stabilizer.answers(Frame(scene.image(index), "mono8", flight.stamp_ns(index)))
    answers += stabilizer.finish()
    rows, columns = np.nonzero(flight.water)
    chosen = np.random.default_rng(0).choice(len(rows), _POINTS)
    water = np.stack([columns, rows], axis=1)[chosen].astype(float)
    found = [(track.ref_H_cur, flight.ref_H_cur(track.index), track.sigma_px) for track in answers[1:]
             if track.ref_H_cur is not None and track.sigma_px is not None]
    off = [apply(H, water) - apply(truth, water) for H, truth, _ in found]
    parallax = [scene.parallax_px(index) for index in range(len(flight))]
    relief = stabilizer.relief
    return ReliefCourse(np.array([math.sqrt((one**2).sum(axis=1).mean()) for one in off]),
                  np.array([sigma for _, _, sigma in found]), float(np.sqrt(np.mean(np.square(parallax)))),
                  None if relief is None else relief.px)


def measure(effort: Effort) -> Section:
    """Error over the water, claimed sigma, and what is told, by the height of the bank."""
    heights = _HEIGHTS if effort.plots else _HEIGHTS[::3]
    courses = {(name, height): fly(RaisedBank(name, height))
               for name in _SCENES for height in heights}
    head = ("scene, height of a bank / of the camera", "parallax, px", "error over the water, median", "max",
            "sigma_px", "warns of, px")
    rows = [(f"{name}, {height:g}", number(one.parallax_px, 2), number(float(np.median(one.error_px)), 3),
             number(float(one.error_px.max()), 3), number(float(np.median(one.sigma_px)), 3),
             "-" if one.told_px is None else number(one.told_px, 2)) for (name, height), one in courses.items()]
    table = Table(f"Parallax, {_SIZE[0]}x{_SIZE[1]}, {_FRAMES} frames", head, rows)
    data = {f"{name} {height:g}": {"parallax_px": one.parallax_px, "error_px": float(np.median(one.error_px)),
                                   "worst_px": float(one.error_px.max()), "told_px": one.told_px}
            for (name, height), one in courses.items()}
    return Section("Relief", [table], data)
