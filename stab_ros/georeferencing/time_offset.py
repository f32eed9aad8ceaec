"""The offset between the clocks of the sensors and of the frames, from gusts that both feel.

A search over offsets finds where the sensors' motion of the image is most like that of the homographies. About it, the
offset solves  sum of m' (m - s(offset)) = 0, m and s the motion by homographies and by sensors, m' the rate of change
of m: the peak of their correlation. As m' is free of the sensors' noise, that noise does not pull the offset to where
interpolation between samples damps it most (instrumental variables: Wright 1928), as least squares would. A constant
error of the attitude and of the height is estimated along.

Only motion that changes tells the offset: a drone that hovers still, or flies on evenly, does not, and that is said.
The sigma allows for errors that are correlated within a second (Liang and Zeger 1986).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.pose_track import PoseTrack
from stab_ros.georeferencing.sensor_motion import SensorMotion, explained
from stab_ros.imaging.camera import Camera

_STEP_S = 0.02  # of the search
_STEP_OFFSET_S, _STEP_WRONG = 0.01, 1e-4  # of the numerical derivatives
_ITERATIONS = 5
_ENOUGH = 0.5  # share of the changing motion that the sensors must explain
_RIVAL = 0.05  # by which another offset may explain less, to be taken for as good
_APART_S = 0.2  # from the best offset to another one
_OUTLIER = 5.0  # residuals beyond that many times their median do not count
_BLOCK_S = 1.0  # within which errors are correlated
_WORST_SIGMA_S = 0.03
_LOWEST = 0.3  # of the height before a step: a step of feet taken for metres would lead below the ground
_SETTLED_S = 0.01  # last step of the offset: beyond it, the iteration has not come to an end
_TOO_FAR = "the sensors' height or attitude is too wrong to tell the time offset"


@dataclass(frozen=True)
class TimeOffset:
    """An estimated offset.

    Attributes:
        offset_s: to be added to the stamps of the samples, as `time_offset_s`.
        sigma_s: its standard deviation.
        explained: share of the changing motion of the image that the sensors then explain, 0 to 1.
    """

    offset_s: float
    sigma_s: float
    explained: float


@dataclass(frozen=True)
class Unobservable:
    """What the data do not tell. reason: one line."""

    reason: str


def estimate_time_offset(camera: Camera, track: PoseTrack, sightings: Sequence[Sighting], plane_m: float,
                         within_s: float = 1.0) -> TimeOffset | Unobservable:
    """Estimates the offset that is left between a track and the frames.

    Args:
        camera: of known K.
        track: poses of the sensors.
        sightings: frames with homographies, some seconds to some minutes.
        plane_m: elevation of the ground that they follow, in the map.
        within_s: greatest offset that is searched for.

    Returns:
        The offset; or why it cannot be told.
    """
    motion = SensorMotion.of_frames(camera, track, sightings, plane_m, within_s + _STEP_S)
    if motion is None:
        return Unobservable("too few frames with homographies and samples of the sensors to estimate the time offset")
    measured = _changing(motion.measured_px())
    offsets = np.arange(-within_s, within_s + _STEP_S / 2, _STEP_S)
    fits = np.array([explained(measured, _changing(motion.of_sensors_px(offset))) for offset in offsets])
    best = int(np.argmax(fits))
    doubt = _doubt(offsets, fits, best)
    return Unobservable(doubt) if doubt else _refined(motion, measured, float(offsets[best]))


def _doubt(offsets: FloatArray, fits: FloatArray, best: int) -> str | None:
    """Why the best offset of a search means nothing."""
    if not fits[best] >= _ENOUGH:
        return (f"the flight is too still to tell the time offset: the sensors explain {max(fits[best], 0):.0%} of "
                f"what changes in the motion of the image, at least {_ENOUGH:.0%} are needed; fly in gusts or nod the "
                "gimbal")
    if best in {0, len(fits) - 1}:
        return f"the time offset is {abs(offsets[best]):g} s or more, search farther"
    peaks = 1 + np.flatnonzero((fits[1:-1] >= fits[:-2]) & (fits[1:-1] >= fits[2:]))
    rivals = [k for k in peaks if abs(offsets[k] - offsets[best]) > _APART_S and fits[k] > fits[best] - _RIVAL]
    if rivals:
        return (f"the flight sways too evenly to tell a time offset of {offsets[best]:.2f} s from one of "
                f"{offsets[rivals[0]]:.2f} s")
    return None


def _refined(motion: SensorMotion, measured: FloatArray, offset_s: float) -> TimeOffset | Unobservable:
    """Gauss-Newton from the best offset of the search; the unknowns are the offset and the constant errors."""
    instrument = -_changing(np.gradient(measured, motion.before_ns / 1e9, axis=0))
    wrong = np.zeros(4)
    for _ in range(_ITERATIONS):
        off = measured - _moved(motion, offset_s, wrong)
        columns = _derivatives(motion, offset_s, wrong)
        size = np.linalg.norm(off, axis=1)
        counts = size <= _OUTLIER * np.median(size)
        instruments = np.stack([instrument, *columns[1:]])[:, counts].reshape(5, -1)
        inverse = _inverse(instruments @ columns[:, counts].reshape(5, -1).T)
        if inverse is None:
            return Unobservable(_TOO_FAR)
        normal = inverse
        step = normal @ instruments @ off[counts].ravel()
        step[4] = np.clip(step[4], (_LOWEST - 1) * (1 + wrong[3]), (1 / _LOWEST - 1) * (1 + wrong[3]))
        offset_s, wrong = offset_s + float(step[0]), wrong + step[1:]
    if not abs(step[0]) < _SETTLED_S:
        return Unobservable(_TOO_FAR)
    blocks = ((motion.before_ns - motion.before_ns[0]) / 1e9 / _BLOCK_S).astype(int)
    pull = np.sum(np.einsum("k,knm->nm", normal[0], np.stack([instrument, *columns[1:]])) * off, axis=1)
    sigma_s = float(np.linalg.norm(np.bincount(blocks[counts], pull[counts])))
    if sigma_s > _WORST_SIGMA_S:
        return Unobservable(f"the flight is too still to tell the time offset: it is {offset_s:.2f} s within "
                            f"{sigma_s:.2f} s")
    return TimeOffset(offset_s, sigma_s, explained(measured[counts], (measured - off)[counts]))


def _inverse(matrix: FloatArray) -> FloatArray | None:
    """The inverse; None: singular, or not finite, as where the sensors see no ground."""
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    return inverse if np.isfinite(inverse).all() else None


def _moved(motion: SensorMotion, offset_s: float, wrong: FloatArray) -> FloatArray:
    """Changing motion (n, 8) by the sensors. wrong: rotation of the body, rad, and share of the height."""
    turn = Rotation.from_rotvec(wrong[:3]).as_matrix()
    return _changing(motion.of_sensors_px(offset_s, motion.plane_m - wrong[3] * motion.height_m, lambda R: R @ turn))


def _derivatives(motion: SensorMotion, offset_s: float, wrong: FloatArray) -> FloatArray:
    """(5, n, 8) of `_moved`, by offset and the four constant errors."""
    by_offset = (_moved(motion, offset_s + _STEP_OFFSET_S, wrong)
                 - _moved(motion, offset_s - _STEP_OFFSET_S, wrong)) / (2 * _STEP_OFFSET_S)
    by_wrong = [(_moved(motion, offset_s, wrong + step) - _moved(motion, offset_s, wrong - step)) / (2 * _STEP_WRONG)
                for step in _STEP_WRONG * np.eye(4)]
    return np.stack([by_offset, *by_wrong])


def _changing(motion_px: FloatArray) -> FloatArray:
    """Motion (n, 8) without its mean, which tells nothing of time."""
    return np.asarray(motion_px - motion_px.mean(axis=0))
