"""Which features move together: planes found by RANSAC over whole trajectories.

One pair of frames cannot tell slow water from ground, a second can: the features of a plane agree with one motion in
every frame. Samples of two features (a similarity in each of four frames, once the common turn and tilt of the camera
are taken off) are ranked by how many others agree in all four; the best is widened to homographies in all frames,
its features are set aside, and the next is sought among the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.kernels import F64, I64, kernel, read
from stab_ros.core.types import BoolArray, FloatArray, Homography, IdArray
from stab_ros.estimation import estimators
from stab_ros.estimation.problem import own_noise, strongest
from stab_ros.tracking.feature_tracks import Trajectories

THRESHOLD_PX = 0.6
_OCTAVES = 3  # samples are ranked by the threshold, its half and its quarter: two planes must not pass for one
_SCATTERS = 4.0  # the features of a plane lie within so many times their median distance from it
_QUARTERS = 4
_RICH, _FAR_MORE = 0.5, 2.5  # of the features that the others show; times as many in the largest plane
_SAMPLES = 1000
_SEED = 20201020
_MOST_PLANES = 4
_LEAST_SHARE = 0.02
_SCATTERED = (2.0, 4.0)  # times the threshold, where hardly anything agrees within it
_FEW = 0.2  # of the features
_LEFT = 0.15  # of the features, which are there in all quarters but on no plane
_HOLDS = 0.25  # of those
_MANY_MORE = 2.0  # times as many
LEAST_FEATURES = 12
_PRESENT = 0.75  # of the frames: with fewer a feature has not kept its template
_AGREES = 0.9  # of the frames it is seen in
_WIDENING = 3
_MOTIONS = (read(F64, 2), read(F64, 3), read(F64, 2))  # start, moved, noise


@dataclass(frozen=True, eq=False)
class Plane:
    """Features that move as one plane.

    member: (N,) bool. ref_H_cur: (F, 3, 3), NaN where a frame gives none. at_rest: whether it has not moved at all in
    the image: it is fixed to the camera, or the camera to the ground. scatter: how many times further than usual its
    features lie off it, as on ground that is uneven or poorly compressed.
    """

    member: BoolArray
    ref_H_cur: FloatArray
    at_rest: bool = False
    scatter: float = 1.0

    def __len__(self) -> int:
        return int(self.member.sum())

    @property
    def known(self) -> BoolArray:
        """(F,) bool: the frames that have a ref_H_cur."""
        return _known(self.ref_H_cur)

    @property
    def last(self) -> Homography:
        """ref_H_cur of the last frame that has one."""
        return np.asarray(self.ref_H_cur[self.known][-1])

    def current_px(self, reference_px: FloatArray) -> FloatArray:
        """Where points on it are in each frame: (F, n, 2) px, NaN where the frame has no ref_H_cur.

        reference_px: (n, 2), the points in the reference.
        """
        cur_H_ref = np.full_like(self.ref_H_cur, np.nan)
        cur_H_ref[self.known] = np.linalg.inv(self.ref_H_cur[self.known])
        return np.stack([apply(H, reference_px) for H in cur_H_ref])

    def reference_px(self, current_px: FloatArray) -> FloatArray:
        """Where points on it are in the reference by each frame: (F, n, 2) px, NaN where that has no ref_H_cur.

        current_px: (F, n, 2), the points in each frame.
        """
        return np.stack([apply(H, at_px) for H, at_px in zip(self.ref_H_cur, current_px, strict=True)])

    def moved_px(self, reference_px: FloatArray) -> float:
        """How far most of its features have moved in the image, at most, px. reference_px: (N, 2), of all features."""
        features_px = reference_px[self.member]
        return _furthest_px(self.current_px(features_px)[self.known] - features_px)

    def apart_px(self, other: Plane, current_px: FloatArray) -> float:
        """How far it and another plane place most of the points apart in the reference, at most, px.

        current_px: (F, n, 2), the points in each frame. Infinite if no frame knows both planes.
        """
        both = self.known & other.known
        return _furthest_px((self.reference_px(current_px) - other.reference_px(current_px))[both])


def find_planes(trajectories: Trajectories, among: BoolArray | None = None,
                threshold_px: float = THRESHOLD_PX) -> list[Plane]:
    """The planes that the features move with, the largest first; none where too few features were followed.

    After a jump to another view, frames that show far fewer features than usual, or than the best one, are left out if
    the rest shows far larger planes.

    among: (N,) bool, which features can belong to one; None: all. threshold_px: largest residual of a feature without
    noise.
    """
    planes = _planes_among(trajectories, among, threshold_px)
    if not _jumps(trajectories):
        return planes
    shown = trajectories.seen.sum(axis=1)
    for usual in (np.median(shown), shown.max()):
        seen = trajectories.seen & (shown >= _RICH * usual)[:, None]
        others = _planes_among(replace(trajectories, seen=seen), among, threshold_px)
        if others and (not planes or len(others[0]) > _FAR_MORE * len(planes[0])):
            planes = others
    return planes


def _jumps(trajectories: Trajectories) -> bool:
    """Whether most features that a frame shows are gone in the next one that shows any."""
    shown = trajectories.seen.sum(axis=1)
    shown = shown[shown > 0]
    return bool(np.any(shown[1:] < _RICH * shown[:-1]))


def _planes_among(trajectories: Trajectories, among: BoolArray | None, threshold_px: float) -> list[Plane]:
    quarters = _quarter_frames(trajectories)
    if not len(quarters):
        return []
    kept: BoolArray = np.all(trajectories.seen[quarters], axis=0)
    kept = kept if among is None else kept & among
    planes = _planes(trajectories, quarters, kept, threshold_px)
    for scatter in _SCATTERED if _largest_share(planes, kept) < _FEW else ():
        wider = _planes(trajectories, quarters, kept, scatter * threshold_px)
        if _largest_share(wider, kept) > _MANY_MORE * _largest_share(planes, kept):
            planes = [replace(plane, scatter=scatter) for plane in wider]
    return [*planes, *_among_the_rest(trajectories, quarters, kept, planes, threshold_px)]


def _among_the_rest(trajectories: Trajectories, quarters: IdArray, kept: BoolArray, planes: list[Plane],
                    threshold_px: float) -> list[Plane]:
    """Scattered planes of many features that are on none: what a codec leaves of banks scatters, water may not."""
    rest = kept & ~np.any([plane.member for plane in planes], axis=0) if planes else np.zeros_like(kept)
    if rest.sum() < max(LEAST_FEATURES, _LEFT * kept.sum()):
        return []
    return max((_scattered(trajectories, quarters, rest, planes, scatter, threshold_px) for scatter in _SCATTERED),
               key=lambda found: sum(map(len, found)))


def _scattered(trajectories: Trajectories, quarters: IdArray, rest: BoolArray, planes: list[Plane], scatter: float,
               threshold_px: float) -> list[Plane]:
    """The planes that hold much of the `rest`, (N,) bool, within so many times the threshold, and are new ones."""
    wide_px = scatter * threshold_px
    return [replace(plane, scatter=scatter) for plane in _planes(trajectories, quarters, rest, wide_px)
            if len(plane) > _HOLDS * rest.sum()
            and not any(_is_part_of(plane, known, trajectories, wide_px) for known in planes)]


def _is_part_of(plane: Plane, other: Plane, trajectories: Trajectories, threshold_px: float) -> bool:
    """Whether a plane moves as another one, which has nearly as many features or more."""
    apart_px = plane.apart_px(other, trajectories.current_px[:, plane.member])
    return apart_px < threshold_px and len(plane) < _MANY_MORE * len(other)


def _planes(trajectories: Trajectories, quarters: IdArray, left: BoolArray, threshold_px: float) -> list[Plane]:
    """The planes among the features `left`, (N,) bool, the largest first."""
    planes: list[Plane] = []
    least = max(LEAST_FEATURES, int(_LEAST_SHARE * len(left)))
    while left.sum() >= least and len(planes) < _MOST_PLANES:
        largest = _largest(trajectories, quarters, left, threshold_px)
        if largest.sum() < least:
            break
        plane = _widened(trajectories, largest, quarters, left, threshold_px)
        if plane is None or len(plane) < least:  # it does not keep together between the quarters
            left = left & ~largest
            continue
        planes.append(plane)
        left = left & ~plane.member
    return sorted(planes, key=len, reverse=True)


def _largest_share(planes: list[Plane], among: BoolArray) -> float:
    return len(planes[0]) / np.sum(among) if planes else 0.0


def _quarter_frames(trajectories: Trajectories) -> IdArray:
    """Up to four of the followed frames, evenly spread, the last one among them."""
    followed = np.flatnonzero(trajectories.seen.any(axis=1))
    at = np.linspace(0, len(followed), _QUARTERS + 1)[1:] - 1
    return np.unique(followed[np.clip(np.round(at).astype(int), 0, None)]) if len(followed) else followed


def _largest(trajectories: Trajectories, quarters: IdArray, left: BoolArray, threshold_px: float) -> BoolArray:
    """(N,) bool: the largest group of `left` that agrees with the similarity of two features in all four frames."""
    which = np.flatnonzero(left)
    start = trajectories.reference_px[which]
    moved = np.stack([apply(trajectories.shapes[f], trajectories.current_px[f, which]) for f in quarters])
    noise = np.stack([noises(trajectories.information[f, which]) for f in quarters])
    samples = np.random.default_rng(_SEED).integers(0, len(which), (_SAMPLES, 2))
    best = _best_sample(samples, start, moved, noise, threshold_px, _OCTAVES)
    member = np.zeros(len(left), bool)
    member[which] = _excess(samples[best, 0], samples[best, 1], start, moved, noise) < threshold_px**2
    return member


def noises(information: FloatArray) -> FloatArray:
    """(N,) px^2: what a feature's own noise adds to the square of any threshold; huge for what was not seen."""
    return own_noise(np.maximum(strongest(information), 1e-9))


@kernel((I64, I64, *_MOTIONS))
def _excess(i: int, j: int, start: FloatArray, moved: FloatArray, noise: FloatArray) -> FloatArray:
    """(N,) px^2: the most that any frame shows beyond noise of each feature off the similarity through i and j."""
    n = len(start)
    excess = np.zeros(n)
    dx, dy = start[j, 0] - start[i, 0], start[j, 1] - start[i, 1]
    length = dx * dx + dy * dy
    if length < 1.0:
        return np.full(n, np.inf)
    for f in range(len(moved)):
        ex, ey = moved[f, j, 0] - moved[f, i, 0], moved[f, j, 1] - moved[f, i, 1]
        a, b = (dx * ex + dy * ey) / length, (dx * ey - dy * ex) / length
        for k in range(n):
            x, y = start[k, 0] - start[i, 0], start[k, 1] - start[i, 1]
            off_x = moved[f, k, 0] - moved[f, i, 0] - (a * x - b * y)
            off_y = moved[f, k, 1] - moved[f, i, 1] - (b * x + a * y)
            excess[k] = max(excess[k], off_x * off_x + off_y * off_y - noise[f, k])
    return excess


@kernel((read(I64, 2), *_MOTIONS, F64, I64))
def _best_sample(samples: IdArray, start: FloatArray, moved: FloatArray, noise: FloatArray, threshold_px: float,
                 octaves: int) -> int:
    """Which of the samples (M, 2) has the most features along, counted once for each threshold."""
    best, most = 0, -1
    for m in range(len(samples)):
        excess = _excess(samples[m, 0], samples[m, 1], start, moved, noise)
        count = 0
        for octave in range(octaves):
            count += np.sum(excess < (threshold_px * 0.5**octave) ** 2)
        if count > most:
            best, most = m, count
    return best


def _widened(trajectories: Trajectories, member: BoolArray, quarters: IdArray, left: BoolArray,
             threshold_px: float) -> Plane | None:
    """The plane that the members lie on, with all that is `left` and agrees, and its homography in every frame."""
    reach_px = threshold_px
    for _ in range(_WIDENING):
        fitted = np.stack([_fitted(trajectories, f, member, threshold_px) for f in quarters])
        if np.isnan(fitted).any():
            return None
        reach_px = max(_reach_px(trajectories, f, H, member, threshold_px)
                       for f, H in zip(quarters, fitted, strict=True))
        agrees = np.stack([_agreeing(trajectories, f, H, reach_px) for f, H in zip(quarters, fitted, strict=True)])
        member = left & agrees.all(axis=0)
    ref_H_cur = np.stack([_fitted(trajectories, f, member, threshold_px) for f in range(len(trajectories.shapes))])
    if not _known(ref_H_cur).any():
        return None
    return Plane(left & persistent(trajectories, ref_H_cur, reach_px), ref_H_cur)


def _reach_px(trajectories: Trajectories, frame: int, ref_H_cur: Homography, member: BoolArray,
              threshold_px: float) -> float:
    """Largest residual of a feature without noise: by the scatter of the members, at most the threshold."""
    off = apply(ref_H_cur, trajectories.current_px[frame, member]) - trajectories.reference_px[member]
    scatter_px = float(np.median(np.hypot(*off.T))) if len(off) else 0.0
    return min(max(_SCATTERS * scatter_px, threshold_px * 0.5 ** (_OCTAVES - 1)), threshold_px)


def _fitted(trajectories: Trajectories, frame: int, member: BoolArray, threshold_px: float) -> Homography:
    """ref_H_cur of one frame by the members; NaN where they do not determine it."""
    pairs = trajectories.pairs(frame, member)
    found = estimators.refine(pairs, "projective", threshold_px, trajectories.shapes[frame], np.ones(len(pairs)))
    return np.full((3, 3), np.nan) if found is None else found


def _agreeing(trajectories: Trajectories, frame: int, ref_H_cur: Homography, reach_px: float) -> BoolArray:
    """(N,) bool: which features are seen in the frame where the homography predicts."""
    off = apply(ref_H_cur, trajectories.current_px[frame]) - trajectories.reference_px
    close = np.sum(off**2, axis=1) < reach_px**2 + noises(trajectories.information[frame])
    return np.asarray(trajectories.seen[frame] & close)


def persistent(trajectories: Trajectories, ref_H_cur: FloatArray, reach_px: float) -> BoolArray:
    """(N,) bool: which features are seen in most of the frames and agree with the plane in nearly all of these."""
    known = np.flatnonzero(_known(ref_H_cur))
    seen = trajectories.seen[known].sum(axis=0)
    agreed = np.stack([_agreeing(trajectories, f, ref_H_cur[f], reach_px) for f in known.tolist()]).sum(axis=0)
    return np.asarray((seen >= _PRESENT * len(known)) & (agreed >= _AGREES * seen))


def _known(ref_H_cur: FloatArray) -> BoolArray:
    """(F,) bool: which of the homographies (F, 3, 3) are not NaN."""
    return np.asarray(~np.isnan(ref_H_cur[:, 0, 0]))


def _furthest_px(off_px: FloatArray) -> float:
    """The largest of the frames' median distances, of (F, n, 2) px; infinite without any frame."""
    return max(np.median(np.hypot(*off_px.T), axis=0).tolist(), default=math.inf)
