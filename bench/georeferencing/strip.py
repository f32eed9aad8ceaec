"""A reach of 180 m from 46 m: where its checkpoints come to lie by GPS alone, keyframes alone, and both.

    .venv/bin/python bench/georeferencing/strip.py

Homographies are simulated (test/helpers/reach.py): 0.05 px of a registration at the corners, and 0.05 px of scale by
each keyframe, always in the same sense. Control points are seen at both ends only.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from stab_ros.core.geometry import apply, normalized
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.fusion import Fused, Fusion, FusionSettings
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.posed import map_H_image_of, turned
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.synthetic.sensors import PPK, SensorModel

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test" / "helpers"))

from reach import CAMERA, Reach, along_reach, checkpoints, where_seen

GCP_PX = 0.3
ENDS_M = np.array([[e, n, 0.0] for n in (-14, 0, 12) for e in (-24, 20)])
GCPS_M = np.concatenate([ENDS_M, ENDS_M + np.array([0.0, 174, 0])])


@dataclass(frozen=True)
class Strip:
    """Errors of checkpoints, m: of single frames (RMS), and of the mean place over all frames that show one."""

    frame_m: float
    mean_m: float
    worst_m: float


def seen_pose(reach: Reach, k: int, rng: np.random.Generator) -> tuple[Pose, FloatArray] | None:
    """Pose and covariance from the control points that frame k shows, at least 6."""
    chosen, pixels = where_seen(reach.view(k), GCPS_M)
    if len(chosen) < 6:
        return None
    pixels = pixels + GCP_PX * rng.standard_normal(pixels.shape)
    start = reach.poses[k]

    def off(change: FloatArray) -> FloatArray:
        return np.asarray((View(CAMERA, turned(start, change)).project(GCPS_M[chosen]) - pixels).ravel())

    found = least_squares(off, np.zeros(6), x_scale=[1, 1, 1, 0.02, 0.02, 0.02])
    J = np.asarray(found.jac, float)
    return turned(start, found.x), GCP_PX**2 * np.linalg.inv(J.T @ J)


def by_sensors(reach: Reach) -> Iterator[Homography | None]:
    """Each frame placed by its pose prior."""
    for k in range(len(reach.poses)):
        prior = reach.track.pose_at(reach.stamp_ns(k))
        yield None if isinstance(prior, Unplaced) else map_H_image_of(CAMERA, prior.pose, 0.0)


def by_keyframes(reach: Reach) -> Iterator[Homography | None]:
    """Each frame placed by its homography and the control points of the first."""
    first = seen_pose(reach, 0, np.random.default_rng([reach.seed, 9]))
    assert first is not None
    map_H_ref = map_H_image_of(CAMERA, first[0], 0.0)
    for sighting in reach.sightings:
        assert sighting.ref_H_cur is not None
        yield normalized(map_H_ref @ sighting.ref_H_cur)


def fused(reach: Reach, settings: FusionSettings, with_gcps: bool, every: int = 10) -> Iterator[Fused | Unplaced]:
    """Each frame placed by all. with_gcps: whether control points are fitted in each tenth frame that shows them."""
    rng, fusion = np.random.default_rng([reach.seed, 9]), Fusion(CAMERA, settings)
    for k, sighting in enumerate(reach.sightings):
        prior = reach.track.pose_at(sighting.stamp_ns)
        seen = seen_pose(reach, k, rng) if with_gcps and k % every == 0 else None
        yield fusion.update(sighting, None if isinstance(prior, Unplaced) else prior, seen)


def maps_of(answers: Iterator[Fused | Unplaced]) -> Iterator[Homography | None]:
    """map_H_image of poses."""
    for answer in answers:
        yield None if isinstance(answer, Unplaced) else map_H_image_of(CAMERA, answer.pose, 0.0)


def strip_of(reach: Reach, maps: Iterator[Homography | None]) -> Strip:
    """What the checkpoints say of frames that are placed so."""
    points = checkpoints()
    off: list[list[FloatArray]] = [[] for _ in points]
    for k, H in enumerate(maps):
        if H is None:
            continue
        chosen, pixels = where_seen(reach.view(k), points)
        for index, place in zip(chosen, apply(H, pixels), strict=True):
            off[index].append(place - points[index, :2])
    errors = [np.array(one) for one in off if len(one) > 3]
    mean = np.linalg.norm([one.mean(axis=0) for one in errors], axis=1)
    single = np.sum(np.concatenate(errors) ** 2, axis=1)
    return Strip(float(np.sqrt(single.mean())), float(np.sqrt(np.mean(mean**2))), float(mean.max()))


def table(sensors: SensorModel, settings: FusionSettings, seeds: range) -> None:
    """Prints the ways side by side."""
    ways: dict[str, Callable[[Reach], Iterator[Homography | None]]] = {
        "GPS and IMU alone": by_sensors,
        "keyframes alone": by_keyframes,
        "fused": lambda reach: maps_of(fused(reach, settings, with_gcps=False)),
        "fused, GCPs at the ends": lambda reach: maps_of(fused(reach, settings, with_gcps=True)),
    }
    print(f"{'m':28}{'frame RMS':>10}{'mean RMS':>10}{'mean max':>10}")
    flights = [Reach(along_reach(), sensors=sensors, seed=seed) for seed in seeds]
    for name, way in ways.items():
        rows = [strip_of(reach, way(reach)) for reach in flights]
        print(f"{name:28}{np.sqrt(np.mean([r.frame_m**2 for r in rows])):10.4f}"
              f"{np.sqrt(np.mean([r.mean_m**2 for r in rows])):10.4f}{max(r.worst_m for r in rows):10.4f}")


if __name__ == "__main__":
    print("PPK: 2 cm and 0.05 degrees, white noise")
    table(PPK, FusionSettings(slow_share=0.0), range(1, 4))
    print("PPK whose noise is half slow (60 s)")
    slow = replace(PPK, position_sigma_m=(0.014,) * 3, drift_sigma_m=(0.014,) * 3)
    table(slow, FusionSettings(slow_share=0.5), range(1, 4))
