"""The reach of `strip.py` on rendered pictures, with the stabiliser itself (`reference:=keyframe`).

    .venv/bin/python bench/georeferencing/strip_rendered.py [--scene NAME] [--every N] [--seeds S ...]
        [--pictures FOLDER]

The pictures are those of `survey("level_strip")` (180 m, 46 m high, 5 km/h, 1360x765): water over half of the image,
banks 0.25 m above it, noise; those of `strip` have banks of 1.6 m, trees and boulders. Checkpoints are the boards on
the banks; control points those at the ends. The place of a
checkpoint is where the pose of a frame puts the exact pixel of it, at its height. One frame takes 1 to 3 s to render;
with --pictures they are kept in a folder and rendered once. The share of the way by which homographies err
(`FusionSettings.relief_share`) was chosen with seeds 1 and 2 of the sensors.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares

from stab_ros.core.geometry import normalized
from stab_ros.core.types import FloatArray, Frame, Gray
from stab_ros.georeferencing.fusion import Fused, Fusion, FusionSettings
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.plane_pose import pose_of_plane
from stab_ros.georeferencing.pose_track import Mounting, PosePrior, PoseTrack
from stab_ros.georeferencing.posed import map_H_image_of, turned
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.synthetic.sensors import PPK, SensorModel, measured
from stab_ros.synthetic.survey_flight import SurveyFlight
from stab_ros.synthetic.survey_scenes import survey
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.stabilizer import Stabilizer

GCP_PX = 0.3
_NO_GRAY = np.zeros((1, 1), np.uint8)
Poses = Iterator[Pose | None]
KnownPose = tuple[Pose, FloatArray]


def picture(flight: SurveyFlight, k: int, folder: Path | None) -> Gray:
    """Frame k, rendered once if there is a folder."""
    if folder is None:
        return np.asarray(flight.image(k), np.uint8)
    path = folder / f"{k:05d}.png"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), flight.image(k))
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))


def registered(flight: SurveyFlight, frames: range, folder: Path | None) -> list[Sighting]:
    """The frames as the stabiliser registers them."""
    stabilizer, tracks = Stabilizer(StabilizerConfig(reference="keyframe")), []
    for k in frames:
        tracks += stabilizer.answers(Frame(picture(flight, k, folder), "mono8", flight.stamp_ns(k)))
    tracks += stabilizer.finish()
    return [Sighting(t.stamp_ns, _NO_GRAY, t.ref_H_cur, t.covariance, reset_counter=t.reset_counter) for t in tracks]


@dataclass(frozen=True, eq=False)
class Strip:
    """A flight, frames of it as they are registered, and its sensors."""

    flight: SurveyFlight
    frames: range
    sightings: list[Sighting]
    sensors: SensorModel = PPK
    seed: int = 1

    @property
    def camera(self) -> Camera:
        return self.flight.view(0).camera

    @property
    def plane_m(self) -> float:
        """Elevation of the ground that is taken for flat: mean of the control points."""
        return float(self.flight.board_m[self.flight.is_control, 2].mean())

    @cached_property
    def track(self) -> PoseTrack:
        got, model = measured(self.flight.map_pose_at, self.flight.duration_s, self.sensors, self.seed), self.sensors
        return PoseTrack(
            [PositionSample(int(t), place, got.position_covariance_m2)
             for t, place in zip(got.position_stamp_ns, got.position_m, strict=True)],
            [AttitudeSample(int(t), q, got.attitude_covariance_rad2)
             for t, q in zip(got.attitude_stamp_ns, got.map_q_body, strict=True)],
            Mounting(np.array(model.lever_arm_m), model.body_R_optical))

    def prior(self, k: int) -> PosePrior | None:
        found = self.track.pose_at(self.flight.stamp_ns(k))
        return None if isinstance(found, Unplaced) else found

    def by_gcps(self, k: int) -> KnownPose | None:
        """Pose and covariance from the control points that frame k shows, at least 5."""
        pixels = self.flight.board_px(k)
        chosen = self.flight.is_control & np.isfinite(pixels).all(axis=1)
        if chosen.sum() < 5:
            return None
        noise = GCP_PX * np.random.default_rng([self.seed, k]).standard_normal((int(chosen.sum()), 2))
        view = self.flight.view(k)

        def off(change: FloatArray) -> FloatArray:
            moved = View(view.camera, turned(view.pose, change)).project(self.flight.board_m[chosen])
            return np.asarray((moved - pixels[chosen] - noise).ravel())

        found = least_squares(off, np.zeros(6), x_scale=[1, 1, 1, 0.02, 0.02, 0.02])
        J = np.asarray(found.jac, float)
        return turned(view.pose, found.x), GCP_PX**2 * np.linalg.inv(J.T @ J)


def by_sensors(strip: Strip) -> Poses:
    """Each frame by its pose prior."""
    for k in strip.frames:
        prior = strip.prior(k)
        yield None if prior is None else prior.pose


def by_keyframes(strip: Strip) -> Poses:
    """Each frame by its homography and the control points of the first."""
    first, camera = strip.by_gcps(0), strip.camera
    assert first is not None
    map_H_ref = map_H_image_of(camera, first[0], strip.plane_m)
    for one in strip.sightings:
        if one.ref_H_cur is None or one.reset_counter != strip.sightings[0].reset_counter:
            yield None
        else:
            yield pose_of_plane(camera, normalized(map_H_ref @ one.ref_H_cur), strip.plane_m)


def fused(strip: Strip, with_gcps: bool) -> Poses:
    """Each frame by all."""
    fusion = Fusion(strip.camera, FusionSettings(strip.plane_m))
    for k, sighting in zip(strip.frames, strip.sightings, strict=True):
        answer = fusion.update(sighting, strip.prior(k), strip.by_gcps(k) if with_gcps else None)
        yield answer.pose if isinstance(answer, Fused) else None


def errors_of(strip: Strip, poses: Poses) -> tuple[float, float, float]:
    """Errors of checkpoints, m: of single frames (RMS), and of the mean place over all frames (RMS and greatest)."""
    off: dict[int, list[FloatArray]] = {}
    flight = strip.flight
    for k, pose in zip(strip.frames, poses, strict=True):
        pixels = flight.board_px(k)
        for board in np.flatnonzero(~flight.is_control & np.isfinite(pixels).all(axis=1)):
            if pose is not None:
                at = View(strip.camera, pose).to_plane(pixels[[board]], flight.board_m[board, 2])[0]
                off.setdefault(int(board), []).append(at - flight.board_m[board, :2])
    mean = np.linalg.norm([np.mean(one, axis=0) for one in off.values()], axis=1)
    single = np.linalg.norm(np.concatenate(list(off.values())), axis=1)
    return float(np.sqrt(np.mean(single**2))), float(np.sqrt(np.mean(mean**2))), float(mean.max())


def table(strips: list[Strip]) -> None:
    """Prints the ways side by side, over the seeds of the sensors."""
    ways: dict[str, Callable[[Strip], Poses]] = {
        "GPS and IMU alone": by_sensors,
        "keyframes alone": by_keyframes,
        "fused": lambda strip: fused(strip, with_gcps=False),
        "fused, GCPs at the ends": lambda strip: fused(strip, with_gcps=True),
    }
    print(f"{'m':28}{'frame RMS':>10}{'mean RMS':>10}{'mean max':>10}")
    for name, way in ways.items():
        found = np.array([errors_of(strip, way(strip)) for strip in strips])
        frame, mean = np.sqrt(np.mean(found[:, :2] ** 2, axis=0))
        print(f"{name:28}{frame:10.4f}{mean:10.4f}{found[:, 2].max():10.4f}")


def main() -> None:
    """Renders, registers, and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=("level_strip", "strip"), default="level_strip", help="banks of the reach")
    parser.add_argument("--every", type=int, default=1, help="take every n-th frame of 1251")
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 4], help="of the sensors")
    parser.add_argument("--pictures", type=Path, help="folder in which pictures are kept")
    given = parser.parse_args()
    flight = SurveyFlight(survey(given.scene))
    frames = range(0, len(flight), given.every)
    sightings = registered(flight, frames, given.pictures)
    lost = sum(one.ref_H_cur is None for one in sightings)
    print(f"{len(frames)} frames, {lost} lost, {sightings[-1].reset_counter} resets")
    print("PPK: 2 cm and 0.05 degrees, white noise")
    table([Strip(flight, frames, sightings, PPK, seed) for seed in given.seeds])
    print("PPK whose positions are half slow (60 s)")
    slow = replace(PPK, position_sigma_m=(0.014,) * 3, drift_sigma_m=(0.014,) * 3)
    table([Strip(flight, frames, sightings, slow, seed) for seed in given.seeds])


if __name__ == "__main__":
    main()
