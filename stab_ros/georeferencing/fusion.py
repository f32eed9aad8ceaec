"""One pose per frame from homographies and sensors: an extended Kalman filter, the same live and from a recording.

Homographies tell how a frame lies to the reference, to some hundredths of a pixel and without jitter, but not where the
reference lies in the map; and beyond the first view (keyframes) their errors add up. Sensors tell where the camera is,
in every frame anew, with noise that is partly white and partly slow.

The state is where four points of the current image lie on the ground plane (c, 8 numbers, `PlanePoints`), and slow
errors (b, 8 Gauss-Markov processes of first order with variance 1): six of the sensors' pose in time, and two of the
homographies along the way. A homography between frames carries the points along; what the stabiliser's own covariance
gained since is added as drift. And it errs by a share of the way: it follows the plane that fits the features in view,
which lies above or below the ground or slopes, as where one bank is followed, and no residual shows that. The share
stays as long as the ground in view does. In each frame the pose p joins them, and all is solved by least squares:

    c(p) = c + error of this registration        where the points are seen from p
    z = p + L b + white error                    the sensors' pose; L L^T is the covariance of its slow part
    s = p + error                                the pose by control points, where some are seen

Then p is dropped again. So many frames average the white errors, and the sensors hold the drift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from stab_ros.core.covariance import factor
from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.plane_points import PlanePoints
from stab_ros.georeferencing.plane_pose import pose_of_plane
from stab_ros.georeferencing.pose_link import PoseLink
from stab_ros.georeferencing.pose_track import PosePrior
from stab_ros.georeferencing.posed import turned
from stab_ros.georeferencing.small_matrices import inverse, solved
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

_ITERATIONS = 2  # of the least squares of a frame; they start within some sigmas
_LEAST_M = 1e-9  # a sigma below is that of the reference itself
_SUREST: FloatArray = np.diag(np.repeat([1e-3, 1e-5], 3) ** 2)  # covariance that no sensor falls below, m^2 and rad^2
_FALLEN = 0.5  # of the sigma before: the stabiliser is back at a better known keyframe


@dataclass(frozen=True)
class FusionSettings:
    """What is taken for known of the errors.

    Attributes:
        plane_m: elevation of the ground that the homographies follow, in the map.
        slow_share: share of the sensors' variance that changes slowly, below 1; the rest is new in each sample.
        position_memory_s: after which the correlation of the slow errors of position is 1 / e.
        attitude_memory_s: the same of attitude.
        model_px: standard deviation of what homographies do not describe: lens, relief, rolling shutter.
        relief_share: standard deviation of the height of what the homographies follow over the plane, as a share of
            that of the camera over it: the share of the way by which they err. The shape of the view errs by half of
            it, new in each view.
        unlikely: probability of an innovation below which sensors and homographies are said to contradict each other.
        patience_s: for so long a contradicted frame is left out; then the sensors are followed.
    """

    plane_m: float = 0.0
    slow_share: float = 0.0
    position_memory_s: float = 60.0
    attitude_memory_s: float = 60.0
    model_px: float = 0.1
    relief_share: float = 0.02
    unlikely: float = 1e-6
    patience_s: float = 2.0


@dataclass(frozen=True, eq=False)
class Fused:
    """The answer for one frame.

    Attributes:
        pose: of the camera.
        covariance: (6, 6) of it, as of `Placement`.
        innovation: how far the sensors' pose lies from the expected one: squared Mahalanobis distance of 8 numbers;
            NaN: there is no pose, or nothing was expected.
        warnings: what makes the answer doubtful: one line each.
        link: what the pose has in common with that of the frame before; None: it is that of the sensors alone.
    """

    pose: Pose
    covariance: FloatArray
    innovation: float = math.nan
    warnings: tuple[str, ...] = ()
    link: PoseLink | None = None


@dataclass(frozen=True, eq=False)
class _State:
    """points: those of the image. x: (16,) c and b. P: (16, 16), its covariance. sigma_m: of drift, so far.

    far_m: greatest distance of the view from the reference, so far. chain: of all frames since the filter began.
    by_pose: what x errs by one standard deviation of each error of the last pose, (16, 6), by the stamp of that.
    """

    points: PlanePoints
    x: FloatArray
    P: FloatArray
    ref_H_cur: Homography
    stamp_ns: int
    sigma_m: float
    far_m: float = 0.0
    chain: object = field(default_factory=object)
    by_pose: Mapping[int, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Observation:
    """A pose that is observed: pose = p + L b + error, covariance (6, 6) of the error, L (6, 8)."""

    pose: Pose
    covariance: FloatArray
    L: FloatArray


@dataclass(eq=False)
class Fusion:
    """The filter: `update` for each frame, in the order of their stamps.

    Attributes:
        camera: of known K.
        settings: of the errors.
    """

    camera: Camera
    settings: FusionSettings = field(default_factory=FusionSettings)
    _state: _State | None = None  # after the last tracked frame
    _reset_counter: int = 0
    _own_m: float = math.inf  # smallest sigma of a homography so far: that of a registration without drift
    _contradicted_ns: int | None = None  # stamp of the first of the frames that are contradicted
    _last_ns: int | None = None

    def update(self, sighting: Sighting, prior: PosePrior | None, seen: tuple[Pose, FloatArray] | None = None,
               ) -> Fused | Unplaced:
        """The pose of a frame.

        Args:
            sighting: the next frame, with its homography if it is not lost.
            prior: what the sensors tell of it; None: nothing.
            seen: pose and covariance (6, 6) from ground control points in this frame; None: there are none.

        Returns:
            The pose; or why it is not known, in one line.
        """
        doubt = None if prior is None else _doubt(prior.covariance)
        if doubt is not None:
            return Unplaced(doubt)
        interval_s = 0.0 if self._last_ns is None else (sighting.stamp_ns - self._last_ns) / 1e9
        self._last_ns = sighting.stamp_ns
        sensors = None if prior is None else self._of_sensors(prior, interval_s)
        control = None if seen is None else _Observation(seen[0], seen[1] + _SUREST, np.zeros((6, 8)))
        if sighting.reset_counter != self._reset_counter:
            self._state, self._reset_counter, self._own_m = None, sighting.reset_counter, math.inf
        if sighting.ref_H_cur is None:
            return self._lost(sighting.stamp_ns, sensors, control)
        if self._state is None:
            return self._start(sighting, sighting.ref_H_cur, sensors, control)
        return self._step(self._state, sighting, sighting.ref_H_cur, sensors, control)

    def _start(self, sighting: Sighting, ref_H_cur: Homography, sensors: _Observation | None,
               control: _Observation | None) -> Fused | Unplaced:
        """The state from observed poses alone."""
        first = control or sensors
        if first is None:
            return Unplaced("no pose of the sensors yet")
        points = PlanePoints.of_view(self.camera, first.pose)
        placed = None if points is None else points.of_pose(first.pose, self.settings.plane_m)
        if points is None or placed is None:
            return self._unseen(first.pose, "its sensors" if control is None else "the control points")
        x = np.concatenate([placed[0], np.zeros(8)])
        information = np.diag(np.repeat([0.0, 1.0], [8, 8]))  # nothing of c, unit variance of b
        state = _State(points, x, np.eye(16), ref_H_cur, sighting.stamp_ns, 0.0)
        registration, sigma_m = self._registration(state, x[:8], sighting, ref_H_cur)
        state = replace(state, sigma_m=sigma_m)
        noise = self._noise(state, x[:8], registration, sigma_m)
        return self._solved(state, information, noise, [one for one in (control, sensors) if one is not None],
                            first.pose)

    def _step(self, state: _State, sighting: Sighting, ref_H_cur: Homography, sensors: _Observation | None,
              control: _Observation | None) -> Fused | Unplaced:
        """The state carried to this frame and corrected by what is observed; contradicted sensors are left out."""
        ahead, noise = self._predicted(state, sighting, ref_H_cur)
        observed = [one for one in (control, sensors) if one is not None]
        innovation = math.nan if sensors is None else self._innovation(ahead, noise, sensors)
        if sensors is None or not innovation > chdtri(8, self.settings.unlikely):
            self._contradicted_ns = None if sensors is not None else self._contradicted_ns
            begin = self._pose_at(ahead.points, ahead.x[:8])
            return self._solved(ahead, inverse(ahead.P), noise, observed, begin, innovation)
        warning = ("sensors and homographies contradict each other: "
                   f"{math.sqrt(innovation / 8):.1f} times as far apart as their sigmas say")
        if self._is_over(sighting.stamp_ns):
            answer = self._start(sighting, ref_H_cur, sensors, control)
        else:
            answer = self._lost(sighting.stamp_ns, sensors, control)
        if isinstance(answer, Unplaced):
            return answer
        return replace(answer, innovation=innovation, warnings=(*answer.warnings, warning))

    def _is_over(self, stamp_ns: int) -> bool:
        """Whether frames have been contradicted for longer than patience lasts."""
        if self._contradicted_ns is None:
            self._contradicted_ns = stamp_ns
        over = stamp_ns - self._contradicted_ns > self.settings.patience_s * 1e9
        if over:
            self._contradicted_ns = None
        return over

    def _predicted(self, state: _State, sighting: Sighting, ref_H_cur: Homography) -> tuple[_State, FloatArray]:
        """The state carried to this frame, and the noise (8, 8) of its registration, m^2."""
        c, F = state.points.carried(state.x[:8], inverse(state.ref_H_cur) @ ref_H_cur)
        by_share = self._by_share(state, c)
        far_m = max(state.far_m, _from_reference_m(state.points, c, ref_H_cur))
        c = c + by_share @ state.x[14:]
        kept = self._kept(sighting.stamp_ns - state.stamp_ns, (far_m - state.far_m) / _view_m(c))
        transition = np.zeros((16, 16))
        transition[:8, :8], transition[:8, 14:], transition[8:, 8:] = F, by_share, np.diag(kept)
        P = transition @ state.P @ transition.T
        P[8:, 8:] += np.diag(1 - kept**2)
        registration, now_m = self._registration(state, c, sighting, ref_H_cur)
        sigma_m = state.sigma_m
        if now_m > sigma_m or now_m < _FALLEN * sigma_m:
            P[:8, :8] += ((now_m - sigma_m) / max(now_m, _LEAST_M)) ** 2 * registration
            sigma_m = now_m
        P[:8, :8] += self._relief(far_m - state.far_m, c)
        x = np.concatenate([c, kept * state.x[8:]])
        by_pose = {stamp_ns: transition @ errors for stamp_ns, errors in state.by_pose.items()}
        ahead = _State(state.points, x, P, ref_H_cur, sighting.stamp_ns, sigma_m, far_m, state.chain, by_pose)
        return ahead, self._noise(state, c, registration, now_m)

    def _registration(self, state: _State, c: FloatArray, sighting: Sighting,
                      ref_H_cur: Homography) -> tuple[FloatArray, float]:
        """Covariance (8, 8) of the points by that of the homography, m^2, and its sigma, RMS."""
        if sighting.covariance is None:
            return np.zeros((8, 8)), 0.0
        covariance = state.points.covariance(c, ref_H_cur, sighting.covariance)
        sigma_m = math.sqrt(np.trace(covariance) / 8)
        if sigma_m > _LEAST_M:
            self._own_m = min(self._own_m, sigma_m)
        return covariance, sigma_m

    def _by_share(self, state: _State, c: FloatArray) -> FloatArray:
        """Derivative (8, 2) of the points by the homographies' slow errors: along the camera's way, and across.

        c: (8,), where the points have come to since `state`.
        """
        before, now = (self._pose_at(state.points, one).position_m for one in (state.x[:8], c))
        east, north, _ = self.settings.relief_share * (now - before)
        return np.tile([[east, -north], [north, east]], (4, 1))

    def _relief(self, advance_m: float, c: FloatArray) -> FloatArray:
        """Covariance (8, 8) of the points, m^2, that new ground adds to the shape of the view."""
        return np.asarray((self.settings.relief_share / 2) ** 2 * _view_m(c) * advance_m * np.eye(8))

    def _noise(self, state: _State, c: FloatArray, registration: FloatArray, sigma_m: float) -> FloatArray:
        """Covariance (8, 8) of what is new in each registration: the share that is no drift, and the model's errors."""
        own = min(1.0, self._own_m / sigma_m) ** 2 if sigma_m > _LEAST_M else 0.0
        return np.asarray(own * registration + state.points.blurred(c, self.settings.model_px))

    def _solved(self, state: _State, information: FloatArray, noise: FloatArray, observed: list[_Observation],
                pose: Pose, innovation: float = math.nan) -> Fused | Unplaced:
        """Least squares over c, b and p, by Gauss-Newton from `pose`; keeps the state.

        information: (16, 16), inverse covariance of c and b before.
        """
        weight = inverse(noise)
        for _ in range(_ITERATIONS):
            placed = state.points.of_pose(pose, self.settings.plane_m)
            if placed is None:
                return self._unseen(pose, "sensors and homographies")
            seen_from = np.concatenate([np.eye(8), np.zeros((8, 8)), -placed[1]], axis=1)
            N, g = _observing(state.x[8:], pose, observed)
            N += seen_from.T @ weight @ seen_from
            N[:16, :16] += information
            step = solved(N, g - seen_from.T @ weight @ (state.x[:8] - placed[0]))
            pose = turned(pose, step[16:])
        covariance = inverse(N)
        own = factor(covariance[16:, 16:])
        by_pose = {state.stamp_ns: covariance[:16, 16:] @ inverse(own).T}
        self._state = replace(state, x=state.x + step[:16], P=covariance[:16, :16], by_pose=by_pose)
        told = covariance[16:, :16] @ information  # of the errors before, by least squares
        link = PoseLink(state.chain, {stamp_ns: told @ one for stamp_ns, one in state.by_pose.items()}
                        | {state.stamp_ns: own})
        return Fused(pose, covariance[16:, 16:], innovation, link=link)

    def _lost(self, stamp_ns: int, sensors: _Observation | None, control: _Observation | None) -> Fused | Unplaced:
        """The observed pose, without the sensors' slow errors as far as they are known; the state stays."""
        observed = [one for one in (control, sensors) if one is not None]
        if not observed:
            return Unplaced("the frame is lost, and the sensors tell nothing of it")
        x, P, pose = np.zeros(8), np.eye(8), observed[0].pose
        if self._state is not None:
            kept = self._kept(stamp_ns - self._state.stamp_ns)
            x, P = kept * self._state.x[8:], kept[:, None] * self._state.P[8:, 8:] * kept + np.diag(1 - kept**2)
        for _ in range(_ITERATIONS):
            N, g = _observing(x, pose, observed)
            N[8:16, 8:16] += inverse(P)
            pose = turned(pose, solved(N[8:, 8:], g[8:])[8:])
        return Fused(pose, inverse(N[8:, 8:])[8:, 8:])

    def _innovation(self, state: _State, noise: FloatArray, sensors: _Observation) -> float:
        """Squared Mahalanobis distance of the points as seen from the sensors' pose to where they are expected."""
        placed = state.points.of_pose(sensors.pose, self.settings.plane_m)
        if placed is None:
            return math.inf
        c, J = placed
        H = np.concatenate([np.eye(8), J @ sensors.L], axis=1)
        S = H @ state.P @ H.T + J @ sensors.covariance @ J.T + noise
        off = c - H @ state.x
        return float(off @ solved(S, off))

    def _unseen(self, pose: Pose, by: str) -> Unplaced:
        """Why the points of the ground are not seen from a pose."""
        if pose.position_m[2] > self.settings.plane_m:
            return Unplaced(f"the camera does not look down on the ground, by {by}")
        ground_m, at_m = self.settings.plane_m, pose.position_m[2]
        return Unplaced(f"the ground at {ground_m:g} m is not below the camera at {at_m:g} m, by {by}; check wse_m and "
                        "ground_above_wse_m, and that all heights have one datum")

    def _pose_at(self, points: PlanePoints, c: FloatArray) -> Pose:
        return pose_of_plane(self.camera, points.homography(c), self.settings.plane_m)

    def _kept(self, interval_ns: int, views: float = 0.0) -> FloatArray:
        """Share (8,) of the slow errors that is left after an interval; views: how much ground is new, in views."""
        memory_s = np.repeat([self.settings.position_memory_s, self.settings.attitude_memory_s], 3)
        return np.asarray(np.exp(-np.append(interval_ns / 1e9 / memory_s, [views, views])))

    def _of_sensors(self, prior: PosePrior, interval_s: float) -> _Observation:
        """The sensors' pose; its white errors count for more where several frames share the samples."""
        covariance = _SUREST if prior.covariance is None else prior.covariance + _SUREST
        shared_s = np.repeat([prior.position_interval_s, prior.attitude_interval_s], 3)
        times = np.sqrt(np.maximum(1.0, shared_s / interval_s)) if interval_s > 0 else np.ones(6)
        slow = math.sqrt(self.settings.slow_share) * np.linalg.cholesky(covariance)
        L = np.concatenate([slow, np.zeros((6, 2))], axis=1)
        return _Observation(prior.pose, (1 - self.settings.slow_share) * covariance * np.outer(times, times), L)


def contradiction(prior: PosePrior, seen: tuple[Pose, FloatArray], unlikely: float) -> float | None:
    """How many times as far apart as their sigmas say the poses by sensors and by control points are.

    Args:
        prior: of the sensors.
        seen: pose by control points, and its covariance (6, 6).
        unlikely: probability of a distance that is told.

    Returns:
        RMS of the six numbers; None: they agree, or the covariance of the sensors is not known.
    """
    if prior.covariance is None:
        return None
    off = _change(seen[0], prior.pose)
    squared = float(off @ solved(prior.covariance + seen[1] + _SUREST, off))
    return math.sqrt(squared / len(off)) if squared > chdtri(len(off), unlikely) else None


def _view_m(c: FloatArray) -> float:
    """Half the side of a view whose points lie at c (8,), m: on such a way the ground in view changes."""
    return float(np.ptp(c[::2]) + np.ptp(c[1::2])) / 4


def _from_reference_m(points: PlanePoints, c: FloatArray, ref_H_cur: Homography) -> float:
    """How far the points, (8,) m, lie from where the reference has them, on average."""
    reference = apply(points.homography(c) @ inverse(ref_H_cur), points.pixels)
    return float(np.linalg.norm((c.reshape(4, 2) - reference).mean(axis=0)))


def _doubt(covariance: FloatArray | None) -> str | None:
    """Why a covariance (6, 6) of the sensors' pose cannot be used."""
    if covariance is None:
        return "the sensors tell no covariance, give position_sigma_m and attitude_sigma_rad"
    if not np.linalg.eigvalsh(covariance + _SUREST)[0] > 0:
        return "the covariance of the sensors is not positive definite, none has such errors"
    return None


def _observing(b: FloatArray, pose: Pose, observed: list[_Observation]) -> tuple[FloatArray, FloatArray]:
    """Normal equations (22, 22), (22,) of observed poses, linear about a pose, for the changes of c, b and p."""
    N, g = np.zeros((22, 22)), np.zeros(22)
    for one in observed:
        M = np.concatenate([np.zeros((6, 8)), one.L, np.eye(6)], axis=1)
        weight = inverse(one.covariance)
        N += M.T @ weight @ M
        g += M.T @ weight @ (_change(pose, one.pose) - one.L @ b)
    return N, g


def _change(before: Pose, after: Pose) -> FloatArray:
    """(6,) by which `turned` makes one pose of the other."""
    turn = Rotation.from_matrix(after.cam_R_map.T @ before.cam_R_map).as_rotvec()
    return np.concatenate([after.position_m - before.position_m, turn])
