"""Whether the river is held: water that looks like ground, a flight in gusts, and a traverse over keyframes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from effort import Effort
from scenes import HD, SEED
from tables import Section, Table, number
from tqdm import tqdm

from stab_ros.core.geometry import rms_distance
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Frame
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.camera_path import Gust, Pose
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.synthetic.river import SceneSettings
from stab_ros.tracking.stabilizer import Stabilizer

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "static_map.png"
_TRAVERSE_S, _REST_S = 10.0, 0.6
_FAR = 3.0  # frame widths


@dataclass(frozen=True, eq=False)
class GroundCourse:
    """error_px, sigma_px: of every frame but the reference, NaN while lost. odds: of an ambiguous choice of ground."""

    error_px: FloatArray
    sigma_px: FloatArray
    odds: float | None
    resets: int
    keyframes: int = 0

    @property
    def lost(self) -> int:
        return int(np.isnan(self.error_px).sum())

    @property
    def within_two(self) -> float:
        found = ~np.isnan(self.error_px)
        return float(np.mean(self.error_px[found] <= 2 * self.sigma_px[found]))

    def data(self) -> dict[str, object]:
        """For the JSON file."""
        return {"median_px": float(np.nanmedian(self.error_px)), "worst_px": float(np.nanmax(self.error_px)),
                "sigma_px": float(np.nanmedian(self.sigma_px)), "within_two_sigma": self.within_two,
                "frames": len(self.error_px), "lost": self.lost, "odds": self.odds, "resets": self.resets}


def fly(flight: Flight, values: Mapping[str, Value]) -> GroundCourse:
    """Tracks a flight as the command does."""
    stabilizer, odds = make_stabilizer(values), None
    error_px, sigma_px = (np.full(len(flight), math.nan) for _ in range(2))
    for shot in tqdm(flight, flight.preset.name, disable=None, leave=False):
        answers = stabilizer.answers(Frame(shot.image, "mono8", shot.stamp_ns))
        answers += stabilizer.finish() if shot.index == len(flight) - 1 else []
        odds = stabilizer.competing_hypothesis.odds if stabilizer.competing_hypothesis else odds
        for track in answers:
            if track.ref_H_cur is not None and track.sigma_px is not None:
                error_px[track.index] = rms_distance(track.ref_H_cur, flight.ref_H_cur(track.index), flight.size)
                sigma_px[track.index] = track.sigma_px
    return GroundCourse(error_px[1:], sigma_px[1:], odds, stabilizer.reset_counter, _keyframes(stabilizer))


def _keyframes(stabilizer: Stabilizer) -> int:
    return stabilizer.keyframes


def trap(name: str, speed_m_s: float, drift: Pose) -> SceneSettings:
    """A preset with rigid water over 70 % of the picture, as strongly textured as the ground."""
    scene = preset(name)
    return replace(scene, stream=replace(scene.stream, width=0.76, speed_m_s=speed_m_s, rigid=True),
                   motion=replace(scene.motion, drift_per_s=drift))


def measure(effort: Effort) -> Section:
    """All of it."""
    tables, data = [], {}
    for title, rows in (("Water that looks like ground", _traps(effort)), ("Flights", _flights(effort)),
                        ("Traverse with keyframes", _traverses(effort))):
        head = (title, "median, px", "worst, px", "sigma, px", "within 2 sigma, %", "frames", "lost", "ambiguous, odds",
                "resets")
        tables.append(Table(title, head, [_row(name, course) for name, course in rows.items()]))
        data[title] = {name: course.data() for name, course in rows.items()}
    if effort.plots:
        draw_map(Flight(trap("kolubara", 0.3, Pose()), (960, 540), 30, SEED))
    return Section("Static ground", tables, data)


def draw_map(flight: Flight) -> None:
    """The reference, and beside it the same with all that was not found to be ground darkened and blue."""
    stabilizer = make_stabilizer({})
    for shot in flight:
        stabilizer.answers(Frame(shot.image, "mono8", shot.stamp_ns))
    assert stabilizer.static_map is not None
    plain = cv2.cvtColor(flight[0].image, cv2.COLOR_GRAY2BGR)
    drawn, water = plain.copy(), stabilizer.static_map.picture() < 128
    drawn[water] = drawn[water] // 2 + np.array([90, 30, 0], np.uint8)
    cv2.imwrite(str(PICTURE), np.hstack([plain, drawn])[::2, ::2])


def _row(name: str, one: GroundCourse) -> tuple[str, ...]:
    return (name, number(float(np.nanmedian(one.error_px)), 4), number(float(np.nanmax(one.error_px)), 4),
            number(float(np.nanmedian(one.sigma_px)), 4), number(100 * one.within_two, 0), str(len(one.error_px)),
            str(one.lost), "-" if one.odds is None else f"{math.exp(one.odds):.1f}", str(one.resets))


def _traps(effort: Effort) -> dict[str, GroundCourse]:
    found = {}
    for name, full in (("kolubara", (4096, 2160)), ("alpine", (3840, 2160))):
        size = full if effort.plots else (960, 540)
        frames = int(1.8 * preset(name).fps) + 2
        for speed_m_s in (0.1, 0.3, 1.0):
            flight = Flight(trap(name, speed_m_s, preset(name).motion.drift_per_s), size, frames, SEED)
            found[f"{name} {size[0]}x{size[1]}, {speed_m_s:g} m/s"] = fly(flight, {})
    for name, speed_m_s in (("kolubara", 0.3), ("alpine", 0.3)):
        scene = trap(name, speed_m_s, Pose(x_m=speed_m_s))
        flight = Flight(scene, HD, int(5 * scene.fps), SEED)
        found[f"{name} {HD[0]}x{HD[1]}, {speed_m_s:g} m/s, camera drifts alike"] = fly(flight, {})
    return found


def _flights(effort: Effort) -> dict[str, GroundCourse]:
    scene, size = preset("basento"), HD
    frames = 900 if effort.plots else 60
    away = Pose(y_m=-0.45 * scene.ground_m[1])  # the lower bank leaves the picture for 200 frames
    leaving = replace(scene.motion, gusts=(Gust(3.0, 1.5, away), Gust(12.0, 1.5, away * -1.0)))
    return {
        f"basento {size[0]}x{size[1]}": fly(Flight(scene, size, frames, SEED), {}),
        "basento, a bank leaves and returns": fly(
            Flight(replace(scene, motion=leaving), size, min(frames, 340), SEED), {}),
    }


def _traverses(effort: Effort) -> dict[str, GroundCourse]:
    found, size = {}, (1280, 720) if effort.plots else (480, 270)
    for name in ("kolubara", "alpine", "basento"):
        scene = preset(name)
        away = Pose(x_m=_FAR * scene.ground_m[0])
        gusts = (Gust(1.5, _TRAVERSE_S, away), Gust(1.5 + _TRAVERSE_S + _REST_S, _TRAVERSE_S, away * -1.0))
        scene = replace(scene, fps=20.0, motion=replace(scene.motion, drift_per_s=Pose(), gusts=gusts))
        frames = int(20 * (3.0 + 2 * _TRAVERSE_S + _REST_S))
        course = fly(Flight(scene, size, frames, SEED), {"reference": "keyframe"})
        found[f"{name} {size[0]}x{size[1]}"] = course
        found[f"{name}, the last second"] = replace(course, error_px=course.error_px[-20:],
                                                    sigma_px=course.sigma_px[-20:])
    return found
