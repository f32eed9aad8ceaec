"""A flight along a reach, as the third paper's Coquet, without pictures: poses, homographies with keyframes, sensors.

The homographies are exact ones with the errors of registrations: white ones of each frame, and one of each keyframe
that all later frames inherit. Their covariance is the one that the stabiliser would tell (`AnchorPose`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stab_ros.core.geometry import apply, inside, jacobian, normalized
from stab_ros.core.types import Fit, FloatArray, Homography, IdArray
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.pose_track import Mounting, PoseTrack
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.synthetic.sensors import FIRST_STAMP_NS, PPK, SensorModel, measured
from stab_ros.tracking.anchor_pose import AT_REFERENCE, AnchorPose

SIZE, FOCAL_PX = (1360, 765), 907.0  # 24 mm on 36 mm: 5 cm per pixel at 46 m
CAMERA = Camera(np.array([[FOCAL_PX, 0, (SIZE[0] - 1) / 2], [0, FOCAL_PX, (SIZE[1] - 1) / 2], [0, 0, 1]]),
                np.zeros(5), "plumb_bob", SIZE)
_GRAY = np.zeros((1, 1), np.uint8)
_CORNERS = np.array([[0.0, 0], [SIZE[0] - 1, 0], [SIZE[0] - 1, SIZE[1] - 1], [0, SIZE[1] - 1]])


def along_reach(gust_deg: float = 1.5, speed: float = 5 / 3.6, height_m: float = 46.0,
                pitch_deg: float = 90.0) -> Callable[[float], Pose]:
    """A flight to the north at this speed, m/s, swaying by gusts of this size."""
    def pose_at(t: float) -> Pose:
        def sway(k: int) -> float:
            return math.sin(1.9 * t + k) + 0.6 * math.sin(0.53 * t + 2 * k) + 0.4 * math.sin(4.1 * t + 3 * k)

        gust = math.radians(gust_deg)
        place = np.array([0.3 * sway(1), speed * t + 0.3 * sway(2), height_m + 0.2 * sway(3)])
        return Pose.of_angles(place, math.pi / 2 + gust * sway(4), math.radians(pitch_deg) + 0.6 * gust * sway(5),
                              0.6 * gust * sway(6))
    return pose_at


@dataclass(frozen=True, eq=False)
class Reach:
    """A flight with its homographies and sensors.

    Attributes:
        pose_at: exact pose at seconds since frame 0.
        duration_s: of the flight.
        fps: frames per second.
        sensors: their model.
        seed: of all noise.
        fit_px: white errors of a registration at the corners of the image.
        ramp_px: error of every keyframe in the same sense: a scale, px at the corners.
        followed_m: elevation of the ground that the homographies follow.
    """

    pose_at: Callable[[float], Pose]
    duration_s: float = 125.0
    fps: float = 10.0
    sensors: SensorModel = PPK
    seed: int = 1
    fit_px: float = 0.05
    ramp_px: float = 0.05
    followed_m: float = 0.0

    @cached_property
    def poses(self) -> list[Pose]:
        return [self.pose_at(k / self.fps) for k in range(round(self.duration_s * self.fps) + 1)]

    def view(self, k: int) -> View:
        return View(CAMERA, self.poses[k])

    def stamp_ns(self, k: int) -> int:
        return FIRST_STAMP_NS + round(k / self.fps * 1e9)

    @cached_property
    def track(self) -> PoseTrack:
        """Of the sensors, with what they tell of their noise."""
        got, model = measured(self.pose_at, self.duration_s, self.sensors, self.seed), self.sensors
        return PoseTrack(
            [PositionSample(int(t), place, got.position_covariance_m2)
             for t, place in zip(got.position_stamp_ns, got.position_m, strict=True)],
            [AttitudeSample(int(t), q, got.attitude_covariance_rad2)
             for t, q in zip(got.attitude_stamp_ns, got.map_q_body, strict=True)],
            Mounting(np.array(model.lever_arm_m), model.body_R_optical))

    @cached_property
    def sightings(self) -> list[Sighting]:
        """Frames with homographies, as keyframes place them."""
        rng = np.random.default_rng([self.seed, 7])
        H_map = [view.image_H_map(self.followed_m) for view in map(self.view, range(len(self.poses)))]
        anchor, pose = 0, AT_REFERENCE
        out = [Sighting(self.stamp_ns(0), _GRAY, np.eye(3), np.zeros((8, 8)))]
        for k in range(1, len(H_map)):
            exact = normalized(H_map[anchor] @ np.linalg.inv(H_map[k]))
            H, covariance = _noisy(exact, self.fit_px * rng.standard_normal((4, 2)), self.fit_px)
            fit = pose.chained(Fit(H, np.ones(1, bool), covariance, self.fit_px))
            total = pose.accumulated(fit, SIZE)
            out.append(Sighting(self.stamp_ns(k), _GRAY, fit.ref_H_cur, total))
            if _overlap(exact) < 0.7:
                ramp = 1 + self.ramp_px / (SIZE[1] / 2)
                middle = np.array([[ramp, 0, (1 - ramp) * SIZE[0] / 2], [0, ramp, (1 - ramp) * SIZE[1] / 2], [0, 0, 1]])
                anchor, pose = k, AnchorPose(normalized(fit.ref_H_cur @ middle), total)
        return out


def _noisy(exact: Homography, moved_px: FloatArray, sigma_px: float) -> tuple[Homography, FloatArray]:
    """A homography whose corners are moved, and its covariance (8, 8)."""
    J = jacobian(exact, _CORNERS).reshape(8, 8)
    to_entries = np.linalg.inv(J)
    H = exact.ravel() + np.append(to_entries @ moved_px.ravel(), 0)
    return H.reshape(3, 3), sigma_px**2 * to_entries @ to_entries.T


def _overlap(anchor_H_cur: Homography) -> float:
    x, y = np.meshgrid(np.linspace(0, SIZE[0] - 1, 21), np.linspace(0, SIZE[1] - 1, 21))
    return float(inside(apply(anchor_H_cur, np.column_stack([x.ravel(), y.ravel()])), SIZE).mean())


def checkpoints(length_m: float = 180.0) -> FloatArray:
    """(n, 3) on the water plane along the reach."""
    north = np.arange(-10.0, length_m, 8.0)
    return np.column_stack([np.tile([-18.0, 14, -3, 22], len(north))[:len(north)], north, np.zeros(len(north))])


def where_seen(view: View, points_m: FloatArray) -> tuple[IdArray, FloatArray]:
    """Indices (n,) of the points in the picture, and their pixels (n, 2)."""
    pixels = view.project(points_m)
    chosen = np.flatnonzero(np.isfinite(pixels).all(axis=1) & inside(np.nan_to_num(pixels, nan=-1.0), SIZE))
    return np.asarray(chosen, np.int64), pixels[chosen]
