"""What is wrong with sensors, in words: axes, heights, covariances, jumps, stale samples.

The axes and the height are judged by the homographies: the image moves as the camera does. Where the sensors do not
explain that motion, the usual mistakes are tried in turn; the one that explains it is named.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.pose_track import PosePrior, PoseTrack
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.georeferencing.sensor_motion import SensorMotion, explained
from stab_ros.georeferencing.unit_checks import is_feet
from stab_ros.imaging.camera import Camera

FASTEST = 40.0  # m/s, of drones
_TURNING = 8.0  # rad/s, of drones and gimbals, for as long as a sample lasts
_FITS, _RIGHT = 0.5, 0.8  # share of the image's motion that sensors explain: at least; by the right convention
_LEFT = 0.3  # of what they do not explain, that the right convention leaves
_MOVES_PX = 3.0  # RMS motion between the frames of a pair from which on it tells anything
_HEIGHT_SHARE, _HEIGHT_SIGMAS = 0.1, 5.0  # of a height that is said to be wrong
_HEIGHT_STEP = 1e-3

_ENU_R_NED: FloatArray = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
_FRD_R_FLU: FloatArray = np.diag([1.0, -1, -1])


def _about_up(R: FloatArray, angle_rad: FloatArray | float) -> FloatArray:
    """Attitudes (n, 3, 3) turned about the vertical."""
    angle = np.broadcast_to(angle_rad, len(R))
    turn = np.zeros((len(R), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1
    return turn @ R


def _yaw(R: FloatArray) -> FloatArray:
    return np.arctan2(R[:, 1, 0], R[:, 0, 0])


CONVENTIONS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "it is one of forward, right, down in north, east, down (NED)": lambda R: _ENU_R_NED @ R @ _FRD_R_FLU,
    "its body has axes forward, right, down (FRD)": lambda R: R @ _FRD_R_FLU,
    "its map has axes north, east, down (NED)": lambda R: _ENU_R_NED @ R,
    "it is the inverse, from the map to the body": lambda R: np.swapaxes(R, 1, 2),
    "its yaw has the wrong sign": lambda R: _about_up(R, -2 * _yaw(R)),
    "its yaw is a heading, clockwise from north": lambda R: _about_up(R, math.pi / 2 - 2 * _yaw(R)),
    "its yaw counts from north": lambda R: _about_up(R, math.pi / 2),
    "its yaw is turned by -90 degrees": lambda R: _about_up(R, -math.pi / 2),
    "its yaw is turned by 180 degrees": lambda R: _about_up(R, math.pi),
}


def check_motion(camera: Camera, track: PoseTrack, sightings: Sequence[Sighting], plane_m: float) -> list[str]:
    """Whether the sensors move the image as the homographies do.

    Args:
        camera: of known K.
        track: the sensors, `time_offset_s` applied.
        sightings: frames with homographies, some seconds to some minutes.
        plane_m: elevation of the ground in the map.

    Returns:
        What is wrong, one line each; nothing also where the image moves too little to tell.
    """
    motion = SensorMotion.of_frames(camera, track, sightings, plane_m)
    if motion is None:
        return []
    measured = motion.measured_px()
    measured, told = _typical(measured, motion.of_sensors_px())
    if math.sqrt(np.mean(measured**2) * 2) < _MOVES_PX:
        return []
    share = explained(measured, told)
    names = {name: explained(*_typical(motion.measured_px(), motion.of_sensors_px(attitudes=convention)))
             for name, convention in CONVENTIONS.items()}
    best = max(names, key=lambda name: names[name])
    said = f"the attitude contradicts the homographies: it explains {max(share, 0):.0%} of the motion of the image"
    if names[best] >= _RIGHT and 1 - names[best] < _LEFT * (1 - share):
        return [f"{said}, {names[best]:.0%} if {best}; it must be forward, left, up in east, north, up (REP-103)"]
    height = _check_height(motion)
    return height if height or share >= _FITS else [f"{said}; check its axes, mount_rad and time_offset_s"]


def _typical(measured: FloatArray, told: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Motions without pairs whose homographies are wrong: those that move ten times as far as is usual."""
    size = np.linalg.norm(measured, axis=1)
    usual = size <= 10 * max(float(np.median(size)), 1.0)
    return measured[usual], told[usual]


def _check_height(motion: SensorMotion) -> list[str]:
    """Whether the height above the ground fits: the image of a low camera moves faster."""
    factor, sigma = 1.0, math.inf
    given_m = motion.height_m
    for _ in range(6):
        ahead, at, behind = (motion.of_sensors_px(plane_m=motion.plane_m + given_m * (1 - factor * (1 + step)))
                             for step in (_HEIGHT_STEP, 0, -_HEIGHT_STEP))
        off, slope = motion.measured_px() - at, (ahead - behind) / (2 * _HEIGHT_STEP)
        if not (np.isfinite(slope).all() and np.sum(slope**2) > 0):
            return []
        size = np.linalg.norm(off, axis=1)
        counts = size <= 5 * np.median(size)
        information = float(np.sum(slope[counts] ** 2))
        factor *= float(np.clip(1 + np.sum((slope * off)[counts]) / information, 0.3, 3.0))
        seconds = ((motion.before_ns - motion.before_ns[0]) / 1e9).astype(int)
        scores = np.bincount(seconds[counts], np.sum(slope * off, axis=1)[counts])
        sigma = float(np.linalg.norm(scores)) / information
    if abs(factor - 1) < max(_HEIGHT_SHARE, _HEIGHT_SIGMAS * sigma * factor):
        return []
    feet = "; feet are taken for metres" if factor < 1 and _are_feet(given_m, given_m * factor, motion.plane_m) else ""
    return [f"the camera is {given_m:.0f} m above the ground by its sensors, {given_m * factor:.0f} m (sigma "
            f"{given_m * factor * sigma:.0f} m) by the homographies{feet}; check fix_height_offset_m "
            "(undulation of the geoid, height of the place of take-off), wse_m and ground_above_wse_m"]


def _are_feet(given_m: float, height_m: float, plane_m: float) -> bool:
    """Whether a height above the ground, or the elevation that it leads to, is given in feet."""
    above_origin = height_m + plane_m > 0  # and so is what is given, which is more
    return is_feet(height_m / given_m) or (above_origin and is_feet((height_m + plane_m) / (given_m + plane_m)))


def check_view(prior: PosePrior) -> str | None:
    """Whether a camera looks down on the ground at all; None: it does."""
    down = float(-prior.pose.cam_R_map[2, 2])
    if down > 0.02:
        return None
    pitch = math.degrees(math.asin(max(-1.0, min(1.0, down))))
    where = "level" if abs(down) <= 0.02 else "upwards"
    return (f"the camera looks {where} (pitch {pitch:.0f} degrees) by its attitude: is that in NED, or is mount_rad "
            "missing (0, 1.5708, 0 for a camera that looks down from a level body)?")


def check_samples(positions: Sequence[PositionSample], attitudes: Sequence[AttitudeSample]) -> list[str]:
    """What samples say of themselves: without covariance, in jumps; one line each."""
    said = []
    if positions and all(one.covariance_m2 is None or not one.covariance_m2.any() for one in positions):
        said.append("the fix comes without covariance, position_sigma_m is taken")
    jumps = [(a, b, speed) for a, b in itertools.pairwise(positions)
             if (speed := _speed(a, b)) > FASTEST]
    if jumps:
        a, b, speed = max(jumps, key=lambda jump: jump[2])
        said.append(f"the fix jumps {counted(len(jumps), 'time')}, the worst by {_apart_m(a, b):.1f} m in "
                    f"{(b.stamp_ns - a.stamp_ns) / 1e9:.2f} s")
    rates = [rate for a, b in itertools.pairwise(attitudes) if (rate := _rate(a, b)) is not None]
    if rates and np.median(rates) > _TURNING:
        said.append(f"the attitude turns by {math.degrees(float(np.median(rates))):.0f} degrees per second: are "
                    "degrees taken for radians?")
    return said


def _apart_m(a: PositionSample, b: PositionSample) -> float:
    return float(np.linalg.norm(b.position_m - a.position_m))


def _speed(a: PositionSample, b: PositionSample) -> float:
    """Between two positions, m/s, beyond what their sigmas allow."""
    sigma_m = sum(3 * math.sqrt(float(np.trace(one.covariance_m2))) for one in (a, b) if one.covariance_m2 is not None)
    return max(_apart_m(a, b) - sigma_m, 0.0) / max((b.stamp_ns - a.stamp_ns) / 1e9, 1e-3)


def _rate(a: AttitudeSample, b: AttitudeSample) -> float | None:
    seconds = (b.stamp_ns - a.stamp_ns) / 1e9
    if seconds <= 0:
        return None
    return 2 * math.acos(min(1.0, abs(float(a.map_q_body @ b.map_q_body)))) / seconds
