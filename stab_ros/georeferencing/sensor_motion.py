"""The motion of the image by the sensors against that by the homographies.

Between two frames half a second apart, the homography moves points of the image, and so do the poses of the sensors
over the ground plane. How far both agree tells whether stamps, axes and heights of the sensors are right; slow errors
of the sensors (GPS drift, a tilted mount) cancel out in the difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.pose_track import PoseTrack
from stab_ros.imaging.camera import Camera

SPAN_S = 0.5  # between the frames of a pair: longer than the noise, shorter than gusts
_TOLERANCE = 0.5  # of the span, by which a pair may be longer
_INSET = 0.1  # of the image, from its border to the points
_LEAST_PAIRS = 20
_NOTHING_PX2 = 1e-12

Attitudes = Callable[[FloatArray], FloatArray]  # map_R_body (n, 3, 3) of other conventions


@dataclass(frozen=True, eq=False)
class SensorMotion:
    """Pairs of frames with what homographies and sensors tell of them.

    Attributes:
        camera: of known K.
        track: the sensors.
        plane_m: elevation of the ground in the map.
        before_ns: (n,) int64, stamps of the first frames of the pairs.
        after_ns: (n,) int64, of the second ones.
        before_H_after: (n, 3, 3), measured.
        margin_s: how far the stamps of the sensors may be shifted without leaving their samples.
    """

    camera: Camera
    track: PoseTrack
    plane_m: float
    before_ns: IdArray
    after_ns: IdArray
    before_H_after: FloatArray
    margin_s: float

    @staticmethod
    def of_frames(camera: Camera, track: PoseTrack, sightings: Sequence[Sighting], plane_m: float,
                  margin_s: float = 0.0) -> SensorMotion | None:
        """All pairs of tracked frames that the sensors cover; None: they are too few."""
        tracked = [one for one in sightings if one.ref_H_cur is not None]
        if len(tracked) < 2 or len(track.positions) < 2 or len(track.attitudes) < 2:
            return None
        stamps = np.array([one.stamp_ns for one in tracked])
        margin_ns = round(margin_s * 1e9)
        low = max(track.positions[0].stamp_ns, track.attitudes[0].stamp_ns) + margin_ns
        high = min(track.positions[-1].stamp_ns, track.attitudes[-1].stamp_ns) - margin_ns
        second = np.searchsorted(stamps, stamps + round(SPAN_S * 1e9))
        pairs = [(i, int(j)) for i, j in enumerate(second) if j < len(stamps)
                 and stamps[j] - stamps[i] < SPAN_S * (1 + _TOLERANCE) * 1e9 and low <= stamps[i] and stamps[j] <= high
                 and tracked[i].reset_counter == tracked[int(j)].reset_counter]
        if len(pairs) < _LEAST_PAIRS:
            return None
        before, after = np.array(pairs).T
        H = np.stack([np.asarray(one.ref_H_cur, float) for one in tracked])
        return SensorMotion(camera, track, plane_m, stamps[before], stamps[after],
                            np.linalg.solve(H[before], H[after]), margin_s)

    @property
    def points_px(self) -> FloatArray:
        """Points (4, 2) whose motion is compared, undistorted pixels of the second frames."""
        shares = np.array([[_INSET, _INSET], [1 - _INSET, _INSET], [1 - _INSET, 1 - _INSET], [_INSET, 1 - _INSET]])
        return np.asarray(shares * (np.array(self.camera.size) - 1))

    def measured_px(self) -> FloatArray:
        """Motion (n, 8) of the points by the homographies, px."""
        return np.asarray((_moved(self.before_H_after, self.points_px) - self.points_px).reshape(-1, 8))

    def of_sensors_px(self, shift_s: float = 0.0, plane_m: float | None = None,
                      attitudes: Attitudes | None = None) -> FloatArray:
        """Motion (n, 8) of the points by the sensors, px; NaN where they see no ground.

        Args:
            shift_s: added to the stamps of the samples.
            plane_m: elevation of the ground; None: the given one.
            attitudes: the conventions that the attitudes follow; None: the right ones.
        """
        plane = self.plane_m if plane_m is None else plane_m
        first, second = (self._image_H_map(stamps, shift_s, plane, attitudes) for stamps in
                         (self.before_ns, self.after_ns))
        ground = np.linalg.inv(second) @ np.column_stack([self.points_px, np.ones(4)]).T  # (n, 3, 4), third: 1 / depth
        moved = _moved(first @ np.linalg.inv(second), self.points_px) - self.points_px
        seen = np.asarray((ground[:, 2] > 0).all(axis=1))
        return np.asarray(np.where(seen[:, None], moved.reshape(-1, 8), np.nan))

    @cached_property
    def height_m(self) -> float:
        """Median height of the antenna above the ground."""
        return float(np.median(self._positions[1][:, 2]) - self.plane_m)

    def _image_H_map(self, stamps_ns: IdArray, shift_s: float, plane_m: float,
                     attitudes: Attitudes | None) -> FloatArray:
        """(n, 3, 3), about the place of the first sample; the third row gives the depth."""
        t = (stamps_ns - self._start_ns) / 1e9 - shift_s
        times, places = self._positions
        place = np.column_stack([np.interp(t, times, places[:, k]) for k in range(3)])
        R = np.asarray(self._slerp(t).as_matrix())
        body = R if attitudes is None else attitudes(R)
        place = place - R @ self.track.mounting.lever_arm_m
        cam_R_map = self.track.mounting.body_R_optical.T @ np.swapaxes(body, 1, 2)
        origin = self._positions[1][0]
        offset = np.column_stack([origin[0] - place[:, 0], origin[1] - place[:, 1], plane_m - place[:, 2]])
        last = np.einsum("nij,nj->ni", cam_R_map, offset)
        return np.asarray(self.camera.K @ np.concatenate([cam_R_map[:, :, :2], last[:, :, None]], axis=2))

    @property
    def _start_ns(self) -> int:
        return int(self.before_ns[0])

    @cached_property
    def _positions(self) -> tuple[FloatArray, FloatArray]:
        samples = self.track.positions
        return (np.array([(s.stamp_ns - self._start_ns) / 1e9 for s in samples]),
                np.stack([s.position_m for s in samples]))

    @cached_property
    def _slerp(self) -> Slerp:
        samples = self.track.attitudes
        times = [(s.stamp_ns - self._start_ns) / 1e9 for s in samples]
        return Slerp(times, Rotation.from_quat(np.stack([s.map_q_body for s in samples])))


def explained(measured_px: FloatArray, of_sensors_px: FloatArray) -> float:
    """Share of the measured motion (n, m) that the sensors' explains: 1 for all, 0 or less for none."""
    off, whole = float(np.sum((of_sensors_px - measured_px) ** 2)), float(np.sum(measured_px**2))
    return 1 - off / max(whole, _NOTHING_PX2) if math.isfinite(off) else -math.inf


def _moved(H: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 4, 2): points (4, 2) mapped by each of H (n, 3, 3)."""
    mapped = np.einsum("nij,kj->nki", H, np.column_stack([points, np.ones(len(points))]))
    return np.asarray(mapped[:, :, :2] / mapped[:, :, 2:])
