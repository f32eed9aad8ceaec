"""Flights tracked as the command and the node track them, beside the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import FloatArray, Frame, Gray, Track
from stab_ros.synthetic.camera_path import Gust, Pose
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.synthetic.river import SceneSettings
from stab_ros.tracking.stabilizer import Stabilizer

SIZE = (480, 270)


@dataclass(frozen=True, eq=False)
class Flown:
    """tracks: by number in the flight. error_px, sigma_px: (n,), NaN while lost or not shown."""

    tracks: dict[int, Track]
    error_px: FloatArray
    sigma_px: FloatArray

    @property
    def lost(self) -> list[int]:
        return [number for number, track in self.tracks.items() if not track.tracked]


def trap(name: str, speed_m_s: float, drift_m_s: float | None = None, width: float = 0.76,
         centre: float | None = None) -> SceneSettings:
    """Rigid water as strongly textured as the ground, over 70 % of the picture; the camera drifts along it, if told."""
    scene = preset(name)
    stream = replace(scene.stream, width=width, speed_m_s=speed_m_s, rigid=True,
                     centre=scene.stream.centre if centre is None else centre)
    drift = scene.motion.drift_per_s if drift_m_s is None else Pose(x_m=drift_m_s)
    return replace(scene, stream=stream, motion=replace(scene.motion, drift_per_s=drift))


def moved(scene: SceneSettings, *gusts: Gust) -> SceneSettings:
    """The scene with these moves of the camera."""
    return replace(scene, motion=replace(scene.motion, gusts=gusts))


def fly(stabilizer: Stabilizer, flight: Flight, spoil: Callable[[int, Gray], Gray | None] | None = None) -> Flown:
    """spoil: what becomes of each picture (None: it is dropped)."""
    shown: list[int] = []
    tracks: dict[int, Track] = {}

    def keep(answers: Iterable[Track]) -> None:
        tracks.update((shown[track.index], track) for track in answers)

    for shot in flight:
        image = shot.image if spoil is None else spoil(shot.index, shot.image)
        if image is not None:
            shown.append(shot.index)
            keep(stabilizer.answers(Frame(image, "mono8", shot.stamp_ns)))
    keep(stabilizer.finish())
    assert sorted(tracks) == shown  # each frame is answered once
    error_px, sigma_px = (np.full(len(flight), math.nan) for _ in range(2))
    for number, track in tracks.items():
        if track.ref_H_cur is not None and track.sigma_px is not None:
            error_px[number] = rms_distance(track.ref_H_cur, flight.ref_H_cur(number), flight.size)
            sigma_px[number] = track.sigma_px
    return Flown(tracks, error_px, sigma_px)
