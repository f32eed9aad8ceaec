"""Held-out points of the water plane, from 46 m: how far each orientation places them from where they are.

    .venv/bin/python bench/georeferencing/orientations.py [--frames 12]

Pictures are rendered (test/helpers/ground_pictures.py), control points marked with a noise of 0.3 px, homographies
those of the real stabiliser, sensors PPK with 2 cm and 0.05 degrees. Distances in m, over all points and frames.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Frame
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.placement import Motion
from stab_ros.georeferencing.posed import sigma_m
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import ORIENTATIONS, GeoreferenceConfig
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.synthetic.sensors import PPK, measured
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.stabilizer import Stabilizer

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test" / "helpers"))

from ground_pictures import GroundPictures

HEIGHT_M, STEP_S, FIRST_NS, MARK_PX = 46.0, 0.1, 10**9, 0.3
CAMERAS = {"1920x1080": (1500.0, (1920, 1080)), "4096x2160": (3200.0, (4096, 2160))}
GCPS_M = np.array([[-20.0, -8, 0], [18, -9, 0], [19, 10, 0], [-19, 9, 0], [0, -10, 0], [-8, 5, 0], [9, 2, 0],
                   [2, 11, 0]])
HELD_OUT = np.stack(np.meshgrid(np.linspace(-16, 16, 7), np.linspace(-8, 8, 5)), axis=-1).reshape(-1, 2)
# pitches at which an orientation makes sense
PITCHES = {name: (90,) if name in ("stationary_nadir", "dynamic_stabilization") else (90, 60) for name in ORIENTATIONS}


def pose_at(at_s: float, pitch_deg: float, gusts: float) -> Pose:
    """Of a drone that hovers; it looks at the origin of the map."""
    pitch, turn = math.radians(pitch_deg), 2 * at_s
    sway = gusts * np.array([0.4 * math.sin(turn), 0.3 * math.sin(1.7 * turn), 0.2 * math.sin(0.8 * turn)])
    return Pose.of_angles(np.array([0, -HEIGHT_M / math.tan(pitch), HEIGHT_M]) + sway,
                          math.pi / 2 + gusts * 0.01 * math.sin(turn),
                          pitch + gusts * 0.01 * math.sin(0.6 * turn), gusts * 0.008 * math.sin(1.3 * turn))


@dataclass(frozen=True)
class Flight:
    """camera, pitch of the view, gusts: 0 for a still camera, else 1; frames: their number."""

    camera: Camera
    pitch_deg: float
    gusts: float
    frames: int

    def view(self, frame: int) -> View:
        return View(self.camera, pose_at(frame * STEP_S, self.pitch_deg, self.gusts))

    def pictures(self, ground: GroundPictures) -> Iterator[Frame]:
        for number in range(self.frames):
            yield Frame(ground.seen_by(self.view(number)), "mono8", FIRST_NS + round(number * STEP_S * 1e9))

    def gcps(self) -> ControlPoints:
        noise = np.random.default_rng(4).normal(0, MARK_PX, (len(GCPS_M), 2))
        return ControlPoints(tuple(f"G{n}" for n in range(len(GCPS_M))), self.view(0).project(GCPS_M) + noise, GCPS_M)

    def tell(self, engine: Georeferencer) -> None:
        """The samples of the sensors."""
        samples = measured(lambda at_s: pose_at(at_s, self.pitch_deg, self.gusts), self.frames * STEP_S, PPK, 11)
        for stamp_ns, place in zip(samples.position_stamp_ns.tolist(), samples.position_m, strict=True):
            engine.add_position(PositionSample(stamp_ns, place, samples.position_covariance_m2))
        for stamp_ns, q in zip(samples.attitude_stamp_ns.tolist(), samples.map_q_body, strict=True):
            engine.add_attitude(AttitudeSample(stamp_ns, q, samples.attitude_covariance_rad2))


def engine_of(orientation: str, flight: Flight) -> Georeferencer:
    """Knows what the orientation needs, and no more."""
    config = GeoreferenceConfig(orientation=orientation, gcp_sigma_px=MARK_PX, gcp_sigma_m=0.0, wse_sigma_m=0.0,
                                height_sigma_m=0.0, sensor_slow_share=0.0)
    if orientation in ("stationary_nadir", "dynamic_stabilization"):
        config = replace(config, height_m=HEIGHT_M)
    gcps = flight.gcps() if "gcps" in orientation else None
    sensors = Sensors(0.0)
    placing = make_orientation(config, flight.camera, True, gcps, sensors)
    engine = Georeferencer(config, flight.camera, placing, sensors)
    if placing.needs_sensors:
        flight.tell(engine)
    return engine


def answers(orientation: str, flight: Flight, ground: GroundPictures) -> Iterator[Georeferenced]:
    """To every frame."""
    engine, stabilizer = engine_of(orientation, flight), Stabilizer(StabilizerConfig(), camera=flight.camera)
    for frame in flight.pictures(ground):
        motion = None
        if not orientation.startswith("stationary") and orientation != "dynamic_gcps":
            track = stabilizer.track(frame)
            motion = None if track.ref_H_cur is None else Motion(track.ref_H_cur, track.covariance)
        yield engine.frame(frame, motion)


def errors(answer: Georeferenced, view: View) -> tuple[FloatArray, FloatArray]:
    """Distances of held-out points, m, and their ratio to what the covariance tells."""
    assert answer.placement is not None, answer.reason
    pixels = view.project(np.column_stack([HELD_OUT, np.zeros(len(HELD_OUT))]))
    H = answer.placement.map_H_image
    off = np.linalg.norm(apply(H, pixels) - HELD_OUT, axis=1)
    if answer.placement.covariance is None or not answer.placement.covariance.any():
        return off, np.full(len(off), np.nan)
    return off, off / sigma_m(H, answer.placement.covariance, pixels)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=12)
    options, ground = parser.parse_args(), GroundPictures()
    print("size       orientation                 pitch   median     RMS      max   median error / sigma")
    for size, (f, (width, height)) in CAMERAS.items():
        K = np.array([[f, 0, (width - 1) / 2 + 3.7], [0, f, (height - 1) / 2 - 4.4], [0, 0, 1]])
        camera = Camera(K, np.zeros(5), "plumb_bob", (width, height))
        for orientation in ORIENTATIONS:
            for pitch_deg in PITCHES[orientation]:
                still = orientation.startswith("stationary")
                flight = Flight(camera, pitch_deg, 0.0 if still else 1.0, 1 if still else options.frames)
                found = [errors(answer, flight.view(number))
                         for number, answer in enumerate(answers(orientation, flight, ground))]
                off, ratio = (np.concatenate(part) for part in zip(*found, strict=True))
                known = ratio[np.isfinite(ratio)]
                print(f"{size}  {orientation:27} {pitch_deg:4}  {np.median(off):8.1e} {np.sqrt(np.mean(off**2)):8.1e} "
                      f"{off.max():8.1e}   {np.median(known) if len(known) else math.nan:.2f}")


if __name__ == "__main__":
    main()
