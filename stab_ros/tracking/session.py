"""One reference and all that belongs to it, from its first frame to its last."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import reduce

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import rms_distance, sigma_px
from stab_ros.core.types import (
    Correspondences,
    Fit,
    FloatArray,
    Gray,
    Homography,
    LostReason,
    ResetReason,
    State,
    Track,
)
from stab_ros.estimation.rows import straightened
from stab_ros.tracking.anchor import Anchor, AnchorFactory, Solve
from stab_ros.tracking.anchor_pose import AT_REFERENCE, AnchorPose
from stab_ros.tracking.frame_stamp import FrameStamp
from stab_ros.tracking.frozen_blocks import CopiedBlocks
from stab_ros.tracking.ground import Ground
from stab_ros.tracking.keyframes import Keyframes
from stab_ros.tracking.motion import CameraMotion
from stab_ros.tracking.parallax import Parallax
from stab_ros.tracking.recovery import Recovery
from stab_ros.tracking.reference import Reference, is_textured
from stab_ros.tracking.registration import Registration
from stab_ros.tracking.rolling_shutter import RollingShutter, with_rows
from stab_ros.tracking.row_registration import RowRegistration
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.start_buffer import BufferedFrame, StartBuffer, StartResult
from stab_ros.tracking.static_map import StaticMap
from stab_ros.tracking.strategies import Adjacent, Fixed, Strategy, Updated

_SPARED_SHARE = 0.5  # of the trusted features of an anchor
_SINGLE = {"fixed": Fixed, "updated": Updated, "adjacent": Adjacent}  # the strategies that keep one anchor

_USUAL = 0.75  # of the usual share of inliers: with fewer, a frame is looked for elsewhere, too
_SHARE_RATE = 0.1  # of the mean over frames
_CONVERGED_PX, _MOST_REGISTRATIONS = 0.1, 3
_PROMISING = 0.2  # of the inliers expected: with fewer a registration leads nowhere


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A frame registered to one anchor. rejected: why not; None: accepted.

    share: inliers of those expected, by weight. agreeing: weight of the inliers. Both are 0 if it is rejected.
    """

    anchor: Anchor
    pairs: Correspondences
    fit: Fit | None
    rejected: LostReason | None
    share: float = 0.0
    agreeing: float = 0.0


class Session:
    """Registers frames to one reference.

    reset_counter: how often a reference was replaced before, or the choice of ground turned; reset_reason: why it rose
    last. found: number of frames
    that matched the reference so far, within the start-up each by the square of the share of features that it shows,
    since some of them match by chance. last_match: the matches of the last frame, and what was fitted to them.
    """

    def __init__(self, reference: Reference, anchor: Anchor, factory: AnchorFactory, config: StabilizerConfig,
                 static_map: StaticMap | None, time_ns: int, reset_counter: int,
                 reset_reason: ResetReason | None = None) -> None:
        """anchor: of the reference, made by `factory`. static_map: where ground is, if known. time_ns: of the frame."""
        self.reference, self.found = reference, 0.0
        self.reset_counter, self.reset_reason = reset_counter, reset_reason
        self.ground = Ground(factory.allowed, static_map)
        self.motion = CameraMotion(reference.frame.size, np.eye(3), time_ns)
        self.parallax = Parallax(reference.frame.size)
        self.rolling_shutter, self.copied = RollingShutter(), CopiedBlocks()
        self.last_match: tuple[Correspondences, Fit | None] | None = None
        self._factory, self._registration = factory, Registration(config, self.reference.frame.size)
        self._strategy = self._strategy_of(anchor, config, factory)
        self._recovery = Recovery(self.ground)
        self._usual_share, self._shares = 0.0, 0  # of inliers: mean, and number of frames

    @property
    def keyframes(self) -> int:
        """Number of keyframes, the reference among them; 0 with another strategy."""
        return len(self._strategy) if isinstance(self._strategy, Keyframes) else 0

    def track(self, stamp: FrameStamp, gray: Gray) -> Track:
        """The answer to a frame, (h, w) uint8: by the first guess that registers it as usual, else the best."""
        attempts: list[_Attempt] = []
        for anchor, guess in self._recovery.guesses(self._strategy, self.motion, gray, stamp.time_ns):
            if all(anchor is not one.anchor for one in attempts):
                anchor.look(gray)
            attempts.append(self._attempt(anchor, gray, guess))
            if attempts[-1].share > _USUAL * self._usual_share:
                break
        best = _best(attempts)
        self.last_match = best.pairs, best.fit
        if best.fit is not None and best.rejected is None:
            self.found += 1
            self._note_share(best.share)
            return self._accepted(stamp, best.anchor, gray, best.pairs, best.fit)
        self.motion = self.motion.standing()
        reason = reduce(LostReason.or_further, (one.rejected for one in attempts if one.rejected is not None))
        return self.lost(stamp, _or_flat(reason, is_textured(gray)), len(attempts[-1].pairs))

    def first(self, stamp: FrameStamp) -> Track:
        """The answer to the reference itself: the identity, exactly."""
        n = len(self._strategy.anchor.features_px)
        return Track(State.TRACKED, stamp.index, stamp.stamp_ns, stamp.stamp_ns, self.reset_counter, n, n, np.eye(3),
                     np.zeros((8, 8)), 0.0, 0.0, reset_reason=self.reset_reason)

    def lost(self, stamp: FrameStamp, reason: LostReason, matches: int = 0) -> Track:
        """The answer to a frame that could not be registered."""
        reference_ns = self.reference.frame.stamp_ns
        return Track(State.LOST, stamp.index, stamp.stamp_ns, reference_ns, self.reset_counter, matches,
                     lost_reason=reason, reset_reason=self.reset_reason)

    def buffer(self, duration_ns: int, time_ns: int) -> bool:
        """Buffers the frames from here on, until it is known what is ground; whether there is anything to find out."""
        allowed = self._factory.allowed_in(self.reference.gray, AT_REFERENCE)
        start = StartBuffer(self.reference, allowed, time_ns, duration_ns, self._seeks_rows)
        self.ground.buffer = start if start.useful else None
        return start.useful

    def follow(self, stamp: FrameStamp, gray: Gray) -> float:
        """Buffers a frame, (h, w) uint8, of the start-up; the share of features that it shows."""
        shown = 0.0 if self.ground.buffer is None else self.ground.buffer.follow(stamp, gray)
        self.found += shown**2
        return shown

    @property
    def has_jumped(self) -> bool:
        """Whether the last frame of the start-up lies far from the one before it."""
        return self.ground.buffer is not None and self.ground.buffer.has_jumped

    def finish(self) -> list[Track]:
        """Ends the start-up: the answers to the buffered frames, by what has been seen so far."""
        buffer, self.ground.buffer = self.ground.buffer, None
        return [] if buffer is None else self._answers(buffer.result())

    def pause(self, ended: bool) -> list[Track]:
        """The answers to the buffered frames, as no frame comes; the start-up goes on if a frame does come.

        ended: nothing more is expected. Then a start-up that has seen enough is finished.
        """
        buffer = self.ground.buffer
        if buffer is None or not buffer.waiting:
            return []
        return self.finish() if ended and buffer.enough else self._answers(buffer.result(provisional=not ended))

    def reconfigure(self, config: StabilizerConfig, factory: AnchorFactory) -> None:
        """Takes other settings; anchors are made anew where that is needed.

        Raises:
            InputError: they leave too few features, or do not fit the reference; nothing has changed then.
        """
        if config.reference != self._registration.config.reference or not factory.makes_as(self._factory):
            self._strategy = self._rebuilt(config, factory)
            self.last_match = None
            self.ground.restrict(factory.allowed)
        self._factory, self._registration = factory, dataclasses.replace(self._registration, config=config)

    def _rebuilt(self, config: StabilizerConfig, factory: AnchorFactory) -> Strategy:
        """The strategy anew, from the present anchor; from the reference if it is that, or is to be."""
        old, gray = self._strategy.anchor, self.reference.gray
        fixed = config.reference == "fixed" or old.gray is gray
        anchor = factory.reference(gray) if fixed else factory.at(old.gray, old.pose)
        if len(anchor.features_px) < config.min_inliers:
            raise InputError(f"{config.method} finds fewer than {config.min_inliers} features in the reference, "
                             "roi and exclude must leave more texture")
        return self._strategy_of(anchor, config, factory)

    def _strategy_of(self, anchor: Anchor, config: StabilizerConfig, factory: AnchorFactory) -> Strategy:
        """The strategy that `reference` names, from `anchor` on."""
        single = _SINGLE.get(config.reference)
        if single is not None:
            return single(self._weighted(anchor))
        if anchor.pose is AT_REFERENCE:
            return Keyframes(self._weighted(anchor), config.max_keyframes)
        keyframes = Keyframes(self._weighted(factory.reference(self.reference.gray)), config.max_keyframes)
        keyframes.resume(self._weighted(anchor))
        return keyframes

    def _weighted(self, anchor: Anchor) -> Anchor:
        if self.ground.prior is not None:
            anchor.set_prior_weights(self.ground.prior)
        return self._block(anchor)

    def _note_share(self, share: float) -> None:
        """The mean over all frames at first, later over the last ones."""
        self._shares += 1
        self._usual_share += max(_SHARE_RATE, 1 / self._shares) * (share - self._usual_share)

    def _attempt(self, anchor: Anchor, gray: Gray, guess: Homography) -> _Attempt:
        pairs, fit = self._register(anchor, gray, guess)
        if fit is None:
            return _Attempt(anchor, pairs, fit, _unfitted(pairs))
        support = anchor.support(pairs, fit)
        rejected = self._registration.rejected(fit, anchor.pose, pairs, anchor.trust[pairs.feature_id], support)
        if rejected is not None:
            return _Attempt(anchor, pairs, fit, rejected)
        return _Attempt(anchor, pairs, fit, None, support.share, support.agreeing)

    def _register(self, anchor: Anchor, gray: Gray, guess: Homography) -> tuple[Correspondences, Fit | None]:
        """Matches and a fit to them, with displacements of the rows where they swing."""
        chains, swings = self._strategy.chains, self._seeks_rows and self.rolling_shutter.known
        match = self._by_rows.near(anchor, gray, guess, chains) if swings else None
        if match is not None:
            return match
        match = self._converged(anchor, gray, guess)
        return self._by_rows.improved(anchor, gray, match, chains) if swings else match

    def _converged(self, anchor: Anchor, gray: Gray, guess: Homography) -> tuple[Correspondences, Fit | None]:
        """Matches and a fit to them; from where that led, again, if it led far."""
        for _ in range(_MOST_REGISTRATIONS):
            pairs, fit = anchor.register(gray, guess, self._solver(anchor), self._strategy.chains)
            if fit is None or pairs.ref_H_cur is None or self._has_converged(fit, pairs.ref_H_cur):
                break
            if anchor.support(pairs, fit).share < _PROMISING:
                break
            guess = fit.ref_H_cur
        return pairs, fit

    def _has_converged(self, fit: Fit, measured_at: Homography) -> bool:
        """Whether the matches were measured so near to the fit that they would be the same there."""
        size = self.reference.frame.size
        moved_px = rms_distance(fit.ref_H_cur, measured_at, size)
        return moved_px <= _CONVERGED_PX or moved_px <= sigma_px(fit.ref_H_cur, fit.covariance, size)

    def _solver(self, anchor: Anchor) -> Solve:
        """Fits matches with the anchor in the frame that it has looked at."""
        return lambda pairs, guess, trust: self._registration.solve(pairs, guess, trust,
                                                                    anchor.frozen[pairs.feature_id])

    @property
    def _seeks_rows(self) -> bool:
        return self._registration.config.rolling_shutter == "auto"

    @property
    def _by_rows(self) -> RowRegistration:
        return RowRegistration(self._registration, self.reference.frame.size)

    def _accepted(self, stamp: FrameStamp, anchor: Anchor, gray: Gray, pairs: Correspondences, fit: Fit) -> Track:
        """The answer to a registered frame, after which anchors, weights and ground are brought up to date."""
        self._strategy.registered(anchor, fit, lambda other: self._checked_by(other, gray, fit))
        self._note_rows(pairs, anchor.trust[pairs.feature_id], fit)
        self.copied.add(anchor.frozen[pairs.feature_id], anchor.trust[pairs.feature_id])
        anchor.update_weights(gray, pairs, fit)
        self._find_fixed(anchor, gray, fit)
        self.parallax.add(straightened(pairs, fit.rows), fit, self.ground.contains(pairs.reference_px))
        self.ground.update(anchor)
        track = self._tracked(stamp, pairs, fit)
        self._recovery.keep(gray, fit.ref_H_cur)
        self._extend(gray, fit)
        self._reconsider(fit.ref_H_cur, stamp.time_ns)
        return track

    def _note_rows(self, pairs: Correspondences, trust: FloatArray, fit: Fit) -> None:
        if self._seeks_rows:
            self.rolling_shutter.add(self._by_rows.residuals(pairs, trust, fit), fit.rows)

    def _checked_by(self, other: Anchor, gray: Gray, fit: Fit) -> Fit | None:
        """The same frame registered to another anchor, too; None if that is rejected, or its rows have swung."""
        if fit.rows is not None:
            return None
        other.look(gray)
        pairs, seen = other.register(gray, fit.ref_H_cur, self._solver(other), chain=False)
        if seen is None:
            return None
        trust, support = other.trust[pairs.feature_id], other.support(pairs, seen)
        return None if self._registration.rejected(seen, other.pose, pairs, trust, support) else seen

    def _tracked(self, stamp: FrameStamp, pairs: Correspondences, fit: Fit) -> Track:
        """The answer of an accepted fit, from which the next frame is predicted."""
        self.motion = self.motion.then(fit.ref_H_cur, stamp.time_ns)
        self._registration = self._registration.after(fit)
        self.copied.moved(self.motion.steps[-1].moved_px)
        size = self.reference.frame.size
        covariance = self.ground.covariance(self._strategy.anchor.pose.accumulated(fit, size), fit.ref_H_cur,
                                            stamp.time_ns)
        covariance = self.rolling_shutter.covariance(covariance, fit.ref_H_cur, fit.rows)
        covariance = self.copied.covariance(covariance, fit.ref_H_cur)
        return Track(State.TRACKED, stamp.index, stamp.stamp_ns, self.reference.frame.stamp_ns, self.reset_counter,
                     len(pairs), int(fit.inlier.sum()), fit.ref_H_cur, covariance, fit.rmse_px,
                     sigma_px(fit.ref_H_cur, covariance, size), rows=fit.rows, simpler_model=fit.model,
                     reset_reason=self.reset_reason)

    def _extend(self, gray: Gray, fit: Fit) -> None:
        """Makes the frame just registered an anchor if the strategy wants that and it has enough features.

        One whose rows have swung would pass that on, so the old anchor serves as long as enough of it is in view.
        """
        config, old = self._registration.config, self._strategy.anchor
        wanted = self._strategy.wants_anchor(fit.ref_H_cur, config)
        if not wanted or (fit.rows is not None and old.share_in_view(fit.ref_H_cur) > _SPARED_SHARE):
            return
        pose = AnchorPose(fit.ref_H_cur, with_rows(old.pose.accumulated(fit, old.size), fit.ref_H_cur, fit.rows))
        anchor = self._factory.at(gray.copy(), pose)
        if len(anchor.features_px) >= config.min_inliers:
            anchor.inherit_weights(old, self.ground.prior)
            self._strategy.add(self._block(anchor))

    def _find_fixed(self, anchor: Anchor, gray: Gray, fit: Fit) -> None:
        """What moves with the camera and not with the ground is left out of all anchors from now on."""
        if self.ground.add_fixed_to_camera(anchor.fixed_to_camera(gray, fit.ref_H_cur)):
            for one in self._strategy.anchors:
                self._block(one)

    def _block(self, anchor: Anchor) -> Anchor:
        if self.ground.fixed_to_camera is not None:
            anchor.block(self.ground.fixed_to_camera)
        return anchor

    def _reconsider(self, ref_H_cur: Homography, time_ns: int) -> None:
        """If the other plane turns out to be the ground, the next frames are registered to that."""
        by_other = self.ground.turned(ref_H_cur, time_ns)
        if by_other is not None:
            self.motion = self.motion.at(by_other)
            self._set_prior_weights()
            self._begin_anew()

    def _begin_anew(self) -> None:
        """What was answered before does not belong to what follows."""
        self.reset_counter, self.reset_reason = self.reset_counter + 1, ResetReason.GROUND

    def _set_prior_weights(self) -> None:
        for anchor in self._strategy.anchors:
            self._block(anchor).set_prior_weights(self.ground.static_map)

    def _answers(self, result: StartResult) -> list[Track]:
        """The answers to buffered frames, by what the start-up takes for ground."""
        self.ground.decide(result)
        self._registration = dataclasses.replace(self._registration, scatter=result.scatter)
        self._set_prior_weights()
        if result.rows_swing:
            self.rolling_shutter.found()
        if result.turned:
            self._begin_anew()
        tracks = [self._answer(frame, result) for frame in result.frames]
        if result.planeless and 2 * sum(track.ref_H_cur is None for track in tracks) > len(tracks):
            tracks = [self._unfounded(frame) for frame in result.frames]
        return [dataclasses.replace(track, provisional=result.provisional) for track in tracks]

    def _unfounded(self, frame: BufferedFrame) -> Track:
        """No answer to a frame of a start-up in which nothing kept together: water does, for some frames."""
        return self.lost(frame.stamp, _or_flat(LostReason.FEW_INLIERS, frame.textured), len(frame.pairs))

    def _answer(self, frame: BufferedFrame, result: StartResult) -> Track:
        fit = self._registration.solve(frame.pairs, frame.guess, frame.trust, frame.frozen)
        if self._seeks_rows and self.rolling_shutter.known:
            fit = self._by_rows.solve(frame.pairs, frame.guess, frame.trust) or fit
        if fit is not None:
            self._note_rows(frame.pairs, frame.trust, fit)
        self.last_match = frame.pairs, fit
        if fit is None:
            reason = _unfitted(frame.pairs)
        else:
            support = result.support(frame.pairs, fit)
            rejected = self._registration.rejected(fit, self._strategy.anchor.pose, frame.pairs, frame.trust, support)
            if rejected is None:
                self._note_share(support.share)
                self.copied.add(frame.frozen, frame.trust)
                return self._tracked(frame.stamp, frame.pairs, fit)
            reason = rejected
        self.motion = self.motion.standing()
        return self.lost(frame.stamp, _or_flat(reason, frame.textured), len(frame.pairs))


def _unfitted(pairs: Correspondences) -> LostReason:
    """Why matches determine no homography."""
    return LostReason.FEW_INLIERS if len(pairs) else LostReason.NO_FEATURES


def _or_flat(reason: LostReason, textured: bool) -> LostReason:
    """The reason, or that the frame has no texture: few features agree in such a one by chance."""
    by_chance = reason.or_further(LostReason.FEW_INLIERS) is LostReason.FEW_INLIERS
    return LostReason.NO_TEXTURE if by_chance and not textured else reason


def _best(attempts: list[_Attempt]) -> _Attempt:
    """The attempt with the largest share of inliers, and of those in several anchors the one with the most inliers.

    Shares do not compare between anchors: a new keyframe has not yet learnt which of its features are water.
    """
    by_anchor: dict[int, _Attempt] = {}
    for attempt in attempts:
        before = by_anchor.get(id(attempt.anchor))
        if before is None or attempt.share > before.share:
            by_anchor[id(attempt.anchor)] = attempt
    return max(by_anchor.values(), key=lambda attempt: attempt.agreeing)
