"""The engine: one frame in, its homography to the reference and the warped frame out.

Live and offline call the same `Stabilizer`: the answer depends on the frames alone, never on a clock.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import is_plausible, sigma_px
from stab_ros.core.gray import depth_scale, to_gray
from stab_ros.core.region import Area
from stab_ros.core.settings import Checked, setting
from stab_ros.core.threads import use_threads
from stab_ros.core.timeline import Timeline
from stab_ros.core.types import (
    NO_POINTS,
    BoolArray,
    Correspondences,
    Fit,
    FloatArray,
    Frame,
    Gray,
    Homography,
    Image,
    Stabilized,
    State,
    Track,
)
from stab_ros.estimation import estimators
from stab_ros.estimation.models import MODELS
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.warp import INTERPOLATION, Allocate, warp
from stab_ros.imaging.window import Window
from stab_ros.methods import METHODS
from stab_ros.tracking.ambiguity import Ambiguity, Verdict
from stab_ros.tracking.anchor import REFERENCE, REFERENCES, Anchor, Placement, make_base, reference_base
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.keyframes import Keyframes
from stab_ros.tracking.parallax import Parallax, Relief
from stab_ros.tracking.points import check_count
from stab_ros.tracking.reference import Motion, Reference, is_textured
from stab_ros.tracking.start_buffer import BufferedFrame, GroundState, StartBuffer, StartResult
from stab_ros.tracking.static_map import StaticMap

_OTHER_BASES = 3  # that a lost frame is sought in, besides the one before
_MAP_EVERY = 50  # frames
_MAP_CHANGED = 0.03  # of the reference


@dataclass(frozen=True)
class StabilizerConfig(Checked):
    """What does not belong to one method; `method_config` is the method's own `Config` (None: its defaults)."""

    method: str = setting("direct", "how features are found again", choices=tuple(METHODS))
    model: str = setting("projective", "transformation model", choices=MODELS)
    estimator: str = setting("magsac", "how the homography is fitted", choices=tuple(estimators.ESTIMATORS))
    reference: str = setting("fixed", "what frames are compared with: the first one; a later one whose features are "
                             "carried to the first; the one before, in a chain; or a keyframe, where the view leaves "
                             "the first", choices=REFERENCES)
    max_keyframes: int = setting(16, "with `reference` keyframe: so many are kept, the far ones are forgotten", 3, 1000)
    update_every: int = setting(1, "with `reference` updated: after so many frames features are found anew", 1, 100000)
    on_lost: str = setting("drop", "image_stabilized of a lost frame: none, the last homography, or unwarped",
                           choices=("drop", "hold", "pass"))
    output_roi: str = setting("", "what image_stabilized shows: 'x, y, width, height' in px of the reference, and "
                              'beyond it if need be; "": the view of the reference')
    output_scale: float = setting(1.0, "px of image_stabilized for one of the reference", 0.02, 1.0)
    interpolation: str = setting("linear", "of image_stabilized", choices=tuple(INTERPOLATION))
    threshold: float = setting(0.5, "a feature further than this from the fit is an outlier, px", 0.01, 20.0)
    ransac_threshold: float = setting(3.0, "of the consensus that ed_ransac filters with `threshold`, px", 0.01, 50.0)
    start_s: float = setting(1.0, "so much header time after the reference its frames are answered late, once it is "
                             "known what is ground, s; roi, exclude, points or static_map make it 0", 0.0, 60.0)
    min_inliers: int = setting(12, "with fewer inliers the frame is lost", 1, 10000)
    min_inlier_share: float = setting(0.1, "with a smaller share of the trusted features in view, or, where a detector "
                                      "finds what it finds, of the matches, the frame is lost",
                                      0.0, 1.0)
    max_sigma: float = setting(1.0, "with a larger uncertainty of the homography the frame is lost, px", 0.001, 100.0)
    threads: int = setting(0, "how many threads this process computes with, which changes no result; 0: one for each "
                           "core, at most 4", 0, 64)
    method_config: object = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.window

    @property
    def window(self) -> Window:
        """What image_stabilized shows."""
        return Window.of(self.output_roi, self.output_scale)


class Stabilizer:
    """Tracks a stream against its first textured frame.

    area: where static ground may be looked for. camera: removes lens distortion first, if given. points_px: (n, 2)
    float64, the features to go by, in px of the reference; none: the method chooses them. static_map: where ground
    is, if that is known.

    Raises:
        InputError: the method takes no points, or they are too few.
    """

    _base: Anchor  # from the first reference on, as all that follows
    _allowed: BoolArray
    _static_map: StaticMap
    _ground_known: bool
    _parallax: Parallax

    def __init__(self, config: StabilizerConfig, area: Area | None = None, camera: Camera | None = None,
                 points_px: FloatArray = NO_POINTS, static_map: StaticMap | None = None) -> None:
        _check_points(config, points_px)
        use_threads(config.threads)
        self._config, self._area, self._points_px, self._camera = config, area or Area(), points_px, camera
        self._given_map = static_map
        self._reference: Reference | None = None
        self._deferral: StartBuffer | None = None
        self._doubt: Ambiguity | None = None
        self._last_match: tuple[Correspondences, Fit | None] | None = None
        self._keyframes: Keyframes | None = None
        self._motion = Motion(np.eye(3), 0)
        self._timeline = Timeline()
        self._frames, self._references, self._learnt = 0, 0, 0

    def step(self, frame: Frame) -> Stabilized:
        """`track` and `warp` in one."""
        track = self.track(frame)
        return Stabilized(track, self.warp(frame, track))

    def answers(self, frame: Frame) -> list[Track]:
        """What this frame makes known, in the order of the stream: nothing at first, then its own track.

        For `start_s` after a reference nothing is answered; then all these frames are, at once. Nothing is deferred
        where regions, points or a map say where ground is.

        Raises:
            InputError: as `track`.
        """
        self._check_size(frame)
        deferral = self._deferral
        if deferral is not None and self._continues(frame):
            index, gray = self._count(frame), self._gray(frame, deferral.reference.grey_scale)
            deferral.follow(index, frame.stamp_ns, self._now_ns, gray)
            return self.finish() if deferral.over else []
        late, before = self.finish(), self._reference
        track = self.track(frame)
        if self._reference is not None and self._reference is not before:
            self._defer(self._reference)
        return [*late, track]

    @property
    def buffering(self) -> bool:
        """Whether answers are being deferred: `answers` or `finish` will give them later."""
        return self._deferral is not None

    @property
    def ground(self) -> GroundState:
        """What is known of the ground in the reference."""
        if self._deferral is not None:
            return self._deferral.ground
        return GroundState.UNDECIDED if self._reference is None else GroundState.DECIDED

    @property
    def frames(self) -> int:
        """How many frames there have been, answered or not: the index of the next one."""
        return self._frames

    def finish(self) -> list[Track]:
        """The answers that are still deferred, by what has been seen so far."""
        deferral, self._deferral = self._deferral, None
        return [] if deferral is None else self._judged(deferral, deferral.outcome())

    def pause(self, ended: bool) -> list[Track]:
        """The answers that are still deferred, as no frame comes.

        The start goes on with the next frame, and what is ground is decided anew. ended: as far as anyone knows nothing
        more will come, so it is judged as by `finish`, and that is the end of a start that has seen enough; else
        whatever moves otherwise than the ground counts as a doubt.
        """
        deferral = self._deferral
        if deferral is None or not deferral.waiting:
            return []
        if ended and deferral.enough:
            return self.finish()
        return self._judged(deferral, deferral.outcome(provisional=not ended))

    def _judged(self, deferral: StartBuffer, outcome: StartResult) -> list[Track]:
        self._static_map, self._ground_known, self._doubt = outcome.static_map, True, outcome.doubt
        self._base.believe(self._static_map)
        self._references += outcome.turned  # what was answered before does not belong to what follows
        kept, self._reference = self._reference, deferral.reference  # which may have been given up meanwhile
        tracks = [self._opened(opening, outcome) for opening in outcome.openings]
        self._reference = kept
        return [dataclasses.replace(track, provisional=outcome.provisional) for track in tracks]

    def track(self, frame: Frame) -> Track:
        """Where the frame lies in the reference; the first textured frame, and one of another kind, becomes it.

        Another kind is another size or encoding. The frame is answered at once, by what is known of the ground so far.

        Raises:
            InputError: `roi`, `exclude`, points or the map do not fit the reference, or the camera does not fit the
                frame.
        """
        self._check_size(frame)
        index = self._count(frame)
        if self._reference is None or not self._continues(frame):
            return self._start(index, frame)
        gray = self._gray(frame, self._reference.grey_scale)
        pairs: Correspondences | tuple[()] = ()
        before = self._base
        for base, guess in self._attempts(gray):
            self._base = base
            pairs, fit = self._align(gray, guess)
            if fit is not None and self._accepts(fit, base.expected(pairs, fit.ref_H_cur), frame.size):
                self._close_loop(before, gray, fit)
                self._learn(pairs, fit)
                track = self._tracked(index, frame.stamp_ns, self._now_ns, pairs, fit, frame.size)
                self._move_base(gray, fit)
                self._reconsider(fit.ref_H_cur)
                return track
        self._base, self._motion = before, self._motion.standing()
        return self._lost(index, frame.stamp_ns, len(pairs))

    def warp(self, frame: Frame, track: Track, allocate: Allocate = np.empty) -> Image | None:
        """The frame in the reference's place; what `on_lost` says for a lost one (None: nothing).

        allocate: gives room for the result by shape and dtype; an unwarped frame needs none.
        """
        H = track.ref_H_cur
        if H is None and self._config.on_lost == "pass":
            return frame.image
        if H is None and self._config.on_lost == "hold" and self._reference is not None:
            H = self._motion.last
        if H is None:
            return None
        return warp(frame.image, H, frame.size, self._config.interpolation, self._camera, self.window, allocate)

    @property
    def window(self) -> Window:
        """What `warp` shows of the reference, and how large."""
        return self._config.window

    def reset_reference(self) -> None:
        """The next textured frame becomes the reference."""
        self._reference = None

    def resume(self, reference: Frame, static_map: StaticMap, reset_counter: int) -> None:
        """Goes on with what `reference`, `static_map` and `reset_counter` were before a restart.

        Raises:
            InputError: the settings do not fit this reference, or find nothing in it.
        """
        self._check_size(reference)
        static_map.check_size(reference.size)
        self._timeline.take(reference.stamp_ns)
        if self._begin(reference, static_map) is None:
            raise InputError(f"{self._config.method} finds nothing in the reference of {reference.kind}")
        self._references = reset_counter + 1

    def reconfigure(self, config: StabilizerConfig, area: Area, points_px: FloatArray = NO_POINTS) -> None:
        """Other settings from the next frame on, against the same reference.

        Raises:
            InputError: `area` or the points do not fit the reference, or leave too little of it; nothing has changed
                then.
        """
        _check_points(config, points_px)
        if self._reference is not None:
            self._rebuild(self._reference, config, self._allowed_by(area, self._reference.frame.size), points_px)
        use_threads(config.threads)
        self._config, self._area, self._points_px = config, area, points_px

    def _rebuild(self, reference: Reference, config: StabilizerConfig, allowed: BoolArray,
                 points_px: FloatArray) -> None:
        """The base anew, where the settings want that; the reference itself if they fix it."""
        old = self._config
        same = ((config.method, config.method_config, config.reference)
                == (old.method, old.method_config, old.reference)
                and np.array_equal(allowed, self._allowed) and np.array_equal(points_px, self._points_px))
        if same:
            return
        what = (config.method, config.method_config, allowed, points_px)
        if config.reference == "fixed" or self._base.gray is reference.gray:
            base = reference_base(reference.gray, *what)
        else:
            base = make_base(self._base.gray, self._base.place, *what)
        if len(base.features_px) < config.min_inliers:
            raise InputError(f"{config.method} finds fewer than {config.min_inliers} features in the reference, "
                             "roi and exclude must leave more texture")
        first = config.reference == "keyframe" and base.place is not REFERENCE
        self._take(base, allowed, config, reference_base(reference.gray, *what) if first else base)
        if not self._ground_known:
            self._static_map = StaticMap.of_mask(allowed)

    @property
    def keyframes(self) -> int:
        """How many keyframes there are, the reference among them; 0 where `reference` is something else."""
        return 0 if self._keyframes is None else len(self._keyframes)

    @property
    def relief(self) -> Relief | None:
        """What shows that the ground is no plane; None: nothing does."""
        return self._parallax.relief if self._reference else None

    @property
    def static_map(self) -> StaticMap | None:
        """Where static ground lies in the reference, as far as it is known."""
        return self._static_map if self._reference else None

    @property
    def rival(self) -> CompetingHypothesis | None:
        """What may be the ground as well as what was taken for it; None: there is no doubt."""
        return self._doubt.rival if self._reference and self._doubt else None

    @property
    def reference(self) -> Frame | None:
        """The frame all others are brought back to."""
        return self._reference.frame if self._reference else None

    @property
    def reset_counter(self) -> int:
        """How often the reference was replaced."""
        return max(0, self._references - 1)

    @property
    def last_match(self) -> tuple[Correspondences, Fit | None] | None:
        """What the last compared frame was judged by: the features found in it, and what was fitted to them."""
        return self._last_match if self._reference else None

    def _allowed_by(self, area: Area, size: tuple[int, int]) -> BoolArray:
        """(h, w) bool: where the area leaves features, and the picture without lens distortion shows anything."""
        allowed = area.allowed(size)
        return allowed if self._camera is None else allowed & self._camera.visible

    def _count(self, frame: Frame) -> int:
        """The number of the next frame."""
        self._timeline.take(frame.stamp_ns)
        self._frames += 1
        return self._frames - 1

    @property
    def _now_ns(self) -> int:
        """The time of the last frame, which goes on evenly where stamps jump."""
        return self._timeline.now_ns

    def _continues(self, frame: Frame) -> bool:
        """Whether the frame can be compared with the reference."""
        return self._reference is not None and self._reference.frame.is_like(frame)

    def _check_size(self, frame: Frame) -> None:
        if self._camera is not None and self._camera.size != frame.size:
            raise InputError(f"camera_info is for {self._camera.size[0]}x{self._camera.size[1]} px, "
                             f"the images have {frame.size[0]}x{frame.size[1]}")

    def _gray(self, frame: Frame, grey_scale: float) -> Gray:
        """The frame as the methods see it: gray, without lens distortion."""
        gray = to_gray(frame, grey_scale)
        return gray if self._camera is None else self._camera.undistort(gray)

    def _start(self, index: int, frame: Frame) -> Track:
        """Take a copy of the frame as the reference, if there is anything in it to find again."""
        if self._given_map is not None:
            self._given_map.check_size(frame.size)
        found = self._begin(frame, self._given_map)
        if found is None:
            return self._lost(index, frame.stamp_ns, 0)
        self._references += 1
        return Track(State.TRACKED, index, frame.stamp_ns, frame.stamp_ns, self.reset_counter, found, found,
                     np.eye(3), np.zeros((8, 8)), 0.0, 0.0)

    def _begin(self, frame: Frame, known_map: StaticMap | None) -> int | None:
        """Prepares all that follows from a reference: how many features it has, None and no change if too few."""
        scale = depth_scale(frame)
        gray = self._gray(frame, scale)
        if not is_textured(gray):
            return None
        own = dataclasses.replace(frame, image=frame.image.copy())  # the caller may use its buffer again
        reference, allowed = Reference(own, gray.copy(), scale), self._allowed_by(self._area, frame.size)
        config = self._config
        base = reference_base(reference.gray, config.method, config.method_config, allowed, self._points_px)
        if len(base.features_px) < config.min_inliers:
            return None
        self._static_map, self._doubt = known_map or StaticMap.of_mask(allowed), None
        self._ground_known = known_map is not None
        self._take(base, allowed, config, base)
        self._parallax = Parallax(frame.size)
        self._reference = reference
        self._motion = Motion(np.eye(3), self._now_ns)
        return len(base.features_px)

    def _defer(self, reference: Reference) -> None:
        """From here on frames are answered late, if there is anything to find out about the ground."""
        config = self._config
        known = self._given_map or self._area.roi or self._area.exclude or len(self._points_px)
        if known or not config.start_s:
            return
        deferral = StartBuffer(reference, self._allowed, self._now_ns, round(config.start_s * 1e9))
        self._deferral = deferral if deferral.useful else None

    def _opened(self, opening: BufferedFrame, outcome: StartResult) -> Track:
        """The late answer to a deferred frame."""
        fit = self._solve(opening.pairs, opening.guess, opening.trust)
        self._last_match = opening.pairs, fit
        if fit is not None and self._accepts(fit, outcome.expected(fit.ref_H_cur), outcome.size):
            return self._tracked(opening.index, opening.stamp_ns, opening.time_ns, opening.pairs, fit, outcome.size)
        self._motion = self._motion.standing()
        return self._lost(opening.index, opening.stamp_ns, len(opening.pairs))

    def _take(self, base: Anchor, allowed: BoolArray, config: StabilizerConfig, first: Anchor) -> None:
        """first: of the keyframes, so that a loop can be closed; the same as `base` unless that is a later one."""
        self._base, self._allowed, self._base_age = self._informed(base), allowed, 0
        self._keyframes = None
        if config.reference == "keyframe":
            self._keyframes = Keyframes(self._informed(first), base.size, config.max_keyframes)
            if first is not base:
                self._keyframes.add(base)
                self._keyframes.take(base)
        self._last_match = None

    def _informed(self, base: Anchor) -> Anchor:
        """A new base, told what is ground if that is known."""
        if self._ground_known:
            base.believe(self._static_map)
        return base

    def _attempts(self, gray: Gray) -> Iterator[tuple[Anchor, Homography]]:
        """Where the frame may lie, by which base: going on as before, having stopped, or wherever it has jumped to."""
        expected, last = self._motion.predict(self._now_ns), self._motion.last
        base = self._base if self._keyframes is None else self._keyframes.choose(expected)
        yield base, expected
        if not is_textured(gray):
            return
        yield base, last
        yield base, base.jumped(gray, last)
        others = [] if self._keyframes is None else self._keyframes.others(last)[:_OTHER_BASES]
        for one in (base, *others):
            found = one.relocated(gray)
            if found is not None:
                yield one, found

    def _close_loop(self, before: Anchor, gray: Gray, fit: Fit) -> None:
        """The base of the frames until now learns its place from a frame that another base has placed."""
        if self._keyframes is None or before is self._base:
            return
        self._keyframes.take(self._base)
        _, seen = before.align(gray, fit.ref_H_cur, self._solve, chain=False)
        if seen is not None and self._accepts(seen, 0.0, before.size):
            both = self._base.place.accumulated(fit, before.size) + seen.covariance  # two comparisons of one frame
            placed = dataclasses.replace(fit, covariance=both)
            self._keyframes.correct(before, before.place.to_base(seen.ref_H_cur), placed)

    def _align(self, gray: Gray, guess: Homography) -> tuple[Correspondences, Fit | None]:
        """Match and fit from a guess."""
        self._last_match = self._base.align(gray, guess, self._solve, chain=self._config.reference == "adjacent")
        return self._last_match

    def _solve(self, pairs: Correspondences, guess: Homography, trust: FloatArray) -> Fit | None:
        config = self._config
        return estimators.fit(pairs, config.model, config.estimator, config.threshold, guess, trust,
                              config.ransac_threshold)

    def _accepts(self, fit: Fit, expected: float, size: tuple[int, int]) -> bool:
        """The gate: a motion that a camera can make, enough agreement, and a certain result of this comparison."""
        if not is_plausible(self._base.place.to_base(fit.ref_H_cur), size):
            return False
        return (
            int(fit.inlier.sum()) >= max(self._config.min_inliers, self._config.min_inlier_share * expected)
            and sigma_px(fit.ref_H_cur, fit.covariance, size) <= self._config.max_sigma
        )

    def _tracked(self, index: int, stamp_ns: int, time_ns: int, pairs: Correspondences, fit: Fit,
                 size: tuple[int, int]) -> Track:
        """The answer of an accepted fit, which the next frames go by."""
        self._motion = self._motion.then(fit.ref_H_cur, time_ns)
        covariance = self._base.place.accumulated(fit, size)
        if self._doubt is not None:
            covariance = covariance + self._doubt.spread(fit.ref_H_cur, time_ns)
        return Track(State.TRACKED, index, stamp_ns, self._reference_stamp_ns, self.reset_counter, len(pairs),
                     int(fit.inlier.sum()), fit.ref_H_cur, covariance, fit.rmse_px,
                     sigma_px(fit.ref_H_cur, covariance, size))

    def _learn(self, pairs: Correspondences, fit: Fit) -> None:
        """The base remembers who agreed; now and then the map is made anew, if much of it has changed."""
        self._base.learn(pairs, fit)
        self._parallax.add(pairs, fit, self._static_map.at(pairs.reference_px) > 0.5)
        self._learnt += 1
        if self._learnt % _MAP_EVERY == 0 and self._base.place is REFERENCE and self._ground_known:
            fresh = StaticMap.of_features(self._base.features_px, self._base.trust, self._static_map.size)
            if fresh.differs(self._static_map) > _MAP_CHANGED:
                self._static_map = fresh

    def _reconsider(self, ref_H_cur: Homography) -> None:
        """Weighs an ambiguous choice of ground again; if the other plane is it, the next frame is sought by that."""
        doubt = self._doubt
        verdict = Verdict.OPEN if doubt is None else doubt.weigh(ref_H_cur, self._now_ns)
        if doubt is None or verdict is Verdict.OPEN:
            return
        self._doubt = None
        if verdict is Verdict.TURNED:
            self._static_map = doubt.rival_map
            self._motion = Motion(doubt.by_rival(ref_H_cur, self._now_ns), self._now_ns)
            for base in self._keyframes.bases if self._keyframes else [self._base]:
                base.believe(doubt.rival_map)
            self._references += 1  # what was answered before does not belong to what follows

    def _move_base(self, gray: Gray, fit: Fit) -> None:
        """The frame just tracked becomes the base if it is time for that; the old one goes on if it cannot."""
        self._base_age += 1
        if not self._wants_base(fit.ref_H_cur):
            return
        config, place = self._config, Placement(fit.ref_H_cur, self._base.place.accumulated(fit, self._base.size))
        base = make_base(gray.copy(), place, config.method, config.method_config, self._allowed, self._points_px)
        if len(base.features_px) < config.min_inliers:
            return
        base.inherit(self._base, self._static_map if self._ground_known else None)
        if self._keyframes is not None:
            self._keyframes.add(base)
        else:
            self._base, self._base_age = base, 0

    def _wants_base(self, ref_H_cur: Homography) -> bool:
        if self._keyframes is not None:
            return self._keyframes.wants_new(ref_H_cur)
        strategy = self._config.reference
        return strategy == "adjacent" or (strategy == "updated" and self._base_age >= self._config.update_every)

    def _lost(self, index: int, stamp_ns: int, matches: int) -> Track:
        return Track(State.LOST, index, stamp_ns, self._reference_stamp_ns, self.reset_counter, matches)

    @property
    def _reference_stamp_ns(self) -> int:
        return self._reference.frame.stamp_ns if self._reference else 0


def _check_points(config: StabilizerConfig, points_px: FloatArray) -> None:
    """Raises InputError for points that the settings have no use for."""
    if len(points_px) and not METHODS[config.method].takes_points:
        raise InputError(f"points: {config.method} finds its features itself, leave out points_file and manual_points")
    check_count(points_px, config.model, config.min_inliers)
