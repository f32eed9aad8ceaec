"""How the camera moves, by the tracker itself on rendered flights, against the exact motion of each frame.

    .venv/bin/python bench/georeferencing/camera_motion.py [--scene kolubara] [--frames 40] [--seeds 2]

The reference is placed by exact control points, so that only registrations err. Printed: RMS error of velocity and
rate, the median error over sigma (Mahalanobis distance over the root of 6; 0.94 for exact covariances), and the share
of all components within 2 sigma (95.4 %).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from stab_ros.core.geometry import grid
from stab_ros.core.types import FloatArray, Frame
from stab_ros.georeferencing.camera_twist import Twist, logarithm
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.placement import Motion
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.stabilizer import Stabilizer

CONFIG = GeoreferenceConfig(orientation="dynamic_gcps_stabilization", gcp_sigma_px=0.001, gcp_sigma_m=0.0)


def motions(flight: Flight) -> Iterator[tuple[Frame, Motion | None]]:
    """The frames of a flight, and how the tracker registers them."""
    stabilizer = Stabilizer(StabilizerConfig())
    frames = [Frame(shot.image, "mono8", shot.stamp_ns) for shot in flight]
    tracks = [track for frame in frames for track in stabilizer.answers(frame)] + stabilizer.finish()
    for frame, track in zip(frames, tracks, strict=True):
        yield frame, None if track.ref_H_cur is None else Motion(track.ref_H_cur, track.covariance,
                                                                 track.reset_counter)


def errors(flight: Flight) -> Iterator[tuple[Twist, FloatArray]]:
    """The twist of each frame, and its error (6,)."""
    camera, sensors = flight.view(0).camera, Sensors(0.0)
    pixels = grid(camera.size)[::5]
    there = np.column_stack([flight.view(0).to_plane(pixels, 0.0), np.zeros(len(pixels))])
    gcps = ControlPoints(tuple(map(str, range(len(there)))), pixels, there)
    engine = Georeferencer(CONFIG, camera, make_orientation(CONFIG, camera, True, gcps, sensors), sensors)
    for number, (frame, motion) in enumerate(motions(flight)):
        twist = engine.frame(frame, motion).twist
        if twist is not None:
            interval_s = 1 / flight.preset.fps
            true = logarithm(flight.view(number - 1).pose, flight.view(number).pose)[0] / interval_s
            yield twist, np.append(twist.linear_m_s, twist.angular_rad_s) - true


def main() -> None:
    """Prints a row of the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="kolubara")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    found = [one for seed in range(1, options.seeds + 1)
             for one in errors(Flight(preset(options.scene), (960, 540), options.frames, seed))]
    off = np.array([error for _, error in found])
    sigmas = np.sqrt([np.diag(twist.covariance) for twist, _ in found])
    rms = [1000 * np.sqrt(np.mean(one[:, part] ** 2)) for one in (off, sigmas) for part in (slice(3), slice(3, 6))]
    distances = [np.sqrt(error @ np.linalg.solve(twist.covariance, error) / 6) for twist, error in found]
    print(f"{len(found)} frames of {options.scene}: {rms[0]:.1f} mm/s, {rms[1]:.2f} mrad/s, told {rms[2]:.1f} and "
          f"{rms[3]:.2f}; median {np.median(distances):.2f}, within 2 sigma {np.mean(np.abs(off) < 2 * sigmas):.1%}")


if __name__ == "__main__":
    main()
