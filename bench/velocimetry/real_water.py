"""Velocities of a real flight without truth: the current, and the bank beside it, which must be at rest.

    PYTHONPATH=.:bench .venv/bin/python bench/velocimetry/real_water.py shared/data/navizence.mp4 --png arrows.png

The tracker's homographies place the frames in pixels of the reference; its static map tells bank from water.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from tables import Table, number

from stab_ros.core.gray import to_gray
from stab_ros.core.types import Frame, Gray
from stab_ros.io.video import VideoFile
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.velocimetry.bank import bank_velocity
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.vectors import Vectors

_GROUND = 128
_ARROW_S = 0.5  # arrows show how far the water moves in this time


def frames_of(path: Path, limit: int) -> list[Frame]:
    """The first frames of a video."""
    with closing(VideoFile(path, None)) as video:
        return [frame for _, frame in islice(video.frames(), limit) if isinstance(frame, Frame)]


def placed(frames: list[Frame], still: bool) -> tuple[list[PlacedFrame], PlaneMask]:
    """Frames in pixels of the reference, and its static ground. still: whether they are left where they lie."""
    stabilizer = make_stabilizer({})
    tracks = [track for frame in frames for track in stabilizer.answers(frame)] + stabilizer.finish()
    ground = stabilizer.static_map
    assert ground is not None
    mask = np.kron(ground.cells, np.ones((4, 4), np.uint8))[: ground.size[1], : ground.size[0]] >= _GROUND
    found = []
    for frame, track in zip(frames, tracks, strict=True):
        if track.ref_H_cur is None or track.covariance is None:
            continue
        H, C = (np.eye(3), np.zeros((8, 8))) if still else (track.ref_H_cur, track.covariance)
        found.append(PlacedFrame(frame.stamp_ns, to_gray(frame), H, C, epoch=track.reset_counter))
    return found, PlaneMask(mask, np.eye(3))


def intervals(frames: list[PlacedFrame], config: VelocityConfig) -> Iterator[tuple[Particles, Vectors]]:
    """The vectors of each interval, with the method that knows what became of the features."""
    method = Particles(config, unit="px")
    for frame in frames:
        vectors = method.add(frame)
        if vectors is not None:
            yield method, vectors


def drawn(gray: Gray, vectors: Vectors) -> Gray:
    """Arrows on the reference."""
    picture = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    speed = np.linalg.norm(vectors.velocity_m_s, axis=1)
    colours = cv2.applyColorMap(np.uint8(255 * np.clip(speed / max(np.percentile(speed, 98), 1e-9), 0, 1)),
                                cv2.COLORMAP_TURBO).reshape(-1, 3)
    for start, velocity, colour in zip(vectors.start_m, vectors.velocity_m_s, colours.tolist(), strict=True):
        tip = start + velocity * _ARROW_S
        cv2.arrowedLine(picture, tuple(map(int, start)), tuple(map(int, tip)), colour, 2, cv2.LINE_AA, 0, 0.25)
    return np.asarray(picture)


def _row(name: str, number_: int, method: Particles, vectors: Vectors, ground: PlaneMask) -> list[str]:
    assert method.last is not None
    bank, speed = bank_velocity(vectors, ground), np.linalg.norm(vectors.velocity_m_s, axis=1)
    on_water = ~ground.holds(vectors.start_m)
    own = np.sqrt(vectors.covariance[on_water, 0, 0])
    dropped = ", ".join(f"{key} {n}" for key, n in method.last.dropped.items() if n)
    return [f"{name}, {number_}", str(method.last.seeded), str(len(vectors)),
            f"{bank.median_m_s[0]:.2f}, {bank.median_m_s[1]:.2f}", f"{bank.sigma_m_s[0]:.2f}, {bank.sigma_m_s[1]:.2f}",
            {True: "yes", False: "NO", None: "-"}[bank.at_rest], str(bank.count),
            *(number(float(np.percentile(speed[on_water], q)), 1) for q in (10, 50, 90)),
            number(float(np.median(own)), 2), dropped]


def main() -> None:
    """Prints a table, one row an interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("video", type=Path)
    parser.add_argument("--frames", type=int, default=52)
    parser.add_argument("--png", type=Path)
    options = parser.parse_args()
    frames, rows = frames_of(options.video, options.frames), []
    for name, still in (("stabilised", False), ("as taken", True)):
        there, ground = placed(frames, still)
        for k, (method, vectors) in enumerate(intervals(there, VelocityConfig())):
            rows.append(_row(name, k, method, vectors, ground))
            if options.png and not still and k == 0:
                cv2.imwrite(str(options.png), drawn(there[0].gray, vectors))
    print(Table(f"{options.video.name}, px/s", [
        "interval", "features", "vectors", "bank", "its sigma", "at rest", "on bank", "water 10 %", "50 %", "90 %",
        "median own sigma", "dropped"], rows).text())


if __name__ == "__main__":
    main()
