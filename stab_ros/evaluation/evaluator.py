"""Residual motion of a stabilised stream: the engine of both the evaluator node and `stab-ros evaluate`.

Ljubicic et al. 2021, section 2.5 (RMSD, displacement, velocity fields) and Zhang et al. 2023, section 2.3 (RMSE).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.region import Area
from stab_ros.core.types import BoolArray, FloatArray, Frame, Homography
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.reference_measures import ReferenceMeasures, View, measures_of
from stab_ros.evaluation.settings import EvaluatorConfig, NamedPoint
from stab_ros.metrics.camera_fixed import CameraFixed
from stab_ros.metrics.comparison import PointComparison
from stab_ros.metrics.homologous import Rmse
from stab_ros.metrics.static_points import StaticPoints
from stab_ros.metrics.verification import VerificationPoint


@dataclass(frozen=True, eq=False)
class Arrival:
    """What has arrived of one frame of a stabilised stream.

    Attributes:
        index: number of the frame in the stream, from 0.
        stamp_ns: the header stamp of the frame, ns.
        ref_H_cur: (3, 3), its homography; None: the frame is lost, or came without one.
        lost: whether the stabiliser lost the frame.
        frame: the stabilised image; None: there is none.
        reference_size: width and height of the reference that the homography belongs to, px; None: unknown.
    """

    index: int
    stamp_ns: int
    ref_H_cur: Homography | None
    lost: bool
    frame: Frame | None
    reference_size: tuple[int, int] | None = None


_LEAST_POINTS = 2  # that are not fixed to the camera, to tell by them that it has moved


@dataclass(frozen=True, eq=False)
class _Seen:
    """The last image. repeats: number of identical images directly before it."""

    arrival: Arrival
    view: View
    repeats: int


class Evaluator:
    """Measures how still a stabilised stream stands, frame by frame, against its first frame or a given reference.

    RMSD, displacement and velocity fields follow Ljubicic et al. 2021, section 2.5; the RMSE of homologous points
    follows Zhang et al. 2023, section 2.3.

    Args:
        config: what to measure; `parameters.make_evaluator` makes it from parameters by name.
        named_points: verification points: name, x and y in pixels of the reference; none: they are chosen.
        area: where verification points may lie; None: everywhere.
    """

    def __init__(self, config: EvaluatorConfig, named_points: Sequence[NamedPoint] = (),
                 area: Area | None = None) -> None:
        self.config = config
        self._named_points = tuple(named_points)
        self._area = area or Area()
        self._measures: ReferenceMeasures | None = None
        self._static = StaticPoints(np.empty((0, 2), np.int64))
        self._fixed = CameraFixed(np.empty((0, 0), np.uint8), np.empty((0, 1, 1)), np.empty((0, 2), np.int64), 0.0)
        self._awaited_ns: int | None = None  # stamp of the reference, until its frame arrives
        self._previous: _Seen | None = None
        self._measured = 0

    @property
    def reference(self) -> Frame | None:
        """The reference frame; None before the first image."""
        return self._measures.frame if self._measures else None

    @property
    def points(self) -> tuple[VerificationPoint, ...]:
        """The verification points; none before the first image."""
        return self._measures.points if self._measures else ()

    @property
    def static(self) -> BoolArray:
        """(n,) bool: which of `points` have moved with the majority so far, and count in the means."""
        return self._static.static & ~self._left_out

    @property
    def camera_fixed(self) -> BoolArray:
        """(n,) bool: which of `points` lie on something that moves with the camera, as dirt on the lens."""
        return self._fixed.fixed

    @property
    def has_hot_pixels(self) -> bool:
        """Whether the camera has so many hot pixels that they are left out of all images."""
        return self._measures is not None and self._measures.hot_pixels.any

    @property
    def points_are_named(self) -> bool:
        """Whether the user gave the points."""
        return bool(self._named_points)

    @property
    def _left_out(self) -> BoolArray:
        """Those fixed to the camera, if others move; the points of the user always count."""
        fixed = self.camera_fixed
        others = not self._named_points and (~fixed).sum() >= _LEAST_POINTS
        return fixed if others else np.zeros(len(fixed), bool)

    @property
    def check_is_due(self) -> bool:
        """Whether RMSE and velocity field are due on the next measured frame (see `rmse_every`)."""
        number = self._measured + 1
        return number == 1 or number % self.config.rmse_every == 0

    def reconfigure(self, config: EvaluatorConfig) -> None:
        """Changes thresholds and scales; what was prepared from the reference stays as it is.

        Args:
            config: the new settings.
        """
        self.config = config

    def change_area(self, area: Area) -> None:
        """Measures elsewhere from the next frame on, against the same reference; votes on its points begin anew.

        Args:
            area: where verification points may lie.

        Raises:
            InputError: a region does not fit the reference; nothing has changed then.
        """
        if self._measures is not None:
            awaited_ns, measures = self._awaited_ns, self._measures
            self._take_up(measures_of(measures.frame, self.config, self._named_points, area, measures.ref_H_raw))
            self._awaited_ns = awaited_ns
        self._area = area

    def use_reference(self, frame: Frame, ref_H_raw: Homography | None = None) -> None:
        """Measures against this image from now on.

        Args:
            frame: the reference; one with the stamp of the current reference changes nothing.
            ref_H_raw: (3, 3), by which it was itself warped; None: it was not.

        Raises:
            InputError: a region or a point that the user gave does not fit it.
        """
        if self._measures is not None and frame.stamp_ns == self._measures.frame.stamp_ns:
            return
        self._take_up(measures_of(frame, self.config, self._named_points, self._area,
                                  np.eye(3) if ref_H_raw is None else ref_H_raw))

    def _take_up(self, measures: ReferenceMeasures) -> None:
        self._measures = measures
        self._static = StaticPoints(measures.centres_px)
        self._fixed = measures.camera_fixed()
        self._awaited_ns = measures.frame.stamp_ns
        self._previous = None
        self._measured = 0

    def step(self, arrival: Arrival, check: bool = True) -> FrameMetrics:
        """Measures one frame.

        Args:
            arrival: the image and its homography.
            check: whether RMSE and velocity field, which take long, may be computed where they are due.

        Returns:
            The measures of the frame.

        Raises:
            InputError: as `use_reference`, for the first image; or the image does not show the view of the reference.
        """
        if arrival.lost or arrival.frame is None:
            return FrameMetrics(arrival.index, arrival.stamp_ns, Outcome.LOST if arrival.lost else Outcome.NO_IMAGE)
        _check_window(arrival.frame, arrival.reference_size)
        measures = self._measures_for(arrival.frame, arrival.ref_H_cur)
        seen, before = self._see(arrival, measures.view_of(arrival.frame, arrival.ref_H_cur)), self._previous
        self._previous = seen
        if arrival.stamp_ns == self._awaited_ns:
            self._awaited_ns = None
            return FrameMetrics(arrival.index, arrival.stamp_ns, Outcome.REFERENCE)
        check = check and self.check_is_due
        self._measured += 1
        adjacent = before if before is not None and before.arrival.index == arrival.index - 1 else None
        return self._metrics(measures, seen, adjacent, check)

    def revised(self, metrics: FrameMetrics) -> FrameMetrics:
        """An earlier frame, without the points that have been found since to be fixed to the camera.

        Args:
            metrics: the measures of the frame.

        Returns:
            The same, where it has none of them.
        """
        left_out = self._left_out
        if metrics.outcome is not Outcome.MEASURED or len(metrics.static) != len(left_out) or not left_out.any():
            return metrics
        static = metrics.static & ~left_out
        return dataclasses.replace(metrics, static=static, values=_revised(metrics, static))

    def _see(self, arrival: Arrival, view: View) -> _Seen:
        before = self._previous
        same = before is not None and np.array_equal(before.view.gray, view.gray)
        return _Seen(arrival, view, before.repeats + 1 if before is not None and same else 0)

    def _measures_for(self, frame: Frame, ref_H_cur: Homography | None) -> ReferenceMeasures:
        if self._measures is None or frame.size != self._measures.frame.size:
            self._measures = None
            self.use_reference(frame, ref_H_cur)
        assert self._measures is not None
        return self._measures

    def _metrics(self, measures: ReferenceMeasures, seen: _Seen, before: _Seen | None, check: bool) -> FrameMetrics:
        view = seen.view
        self._static.vote(view.shifts_px, view.searched)
        clear = self._clear_in(view)
        counted = self.static & clear
        reference = measures.compare(measures.view, view, clear)
        points = {"rmsd_reference": reference.rmsd, "displacement_reference_px": reference.displacement_px,
                  "shift_u_px": view.shifts_px[:, 0], "shift_v_px": view.shifts_px[:, 1]}
        if before is not None:
            previous = measures.compare(before.view, view, clear)
            points |= {"rmsd_previous": previous.rmsd, "displacement_previous_px": previous.displacement_px}
        values = _means(points, counted) | self._counts(reference, seen, counted)
        field = None
        if check:
            rmse = _homologous(measures, view, before.view if before is not None else None)
            values |= _rmse_values(rmse)
            field = measures.velocity.measure(view.gray, view.valid, rmse.ref_H_cur)
        return FrameMetrics(seen.arrival.index, seen.arrival.stamp_ns, Outcome.MEASURED,
                            values | self._in_metres(values, seen, before), points, self.static, field,
                            reference.beyond)

    def _clear_in(self, view: View) -> BoolArray:
        """(n,) bool: the points that nothing fixed to the camera disturbs in this frame; all of the user's."""
        disturbed = np.zeros(len(self.points), bool)
        if view.fixed_H_ref is not None:
            disturbed = self._fixed.vote(view.gray, view.valid, view.windows, view.fixed_H_ref)
        return ~self._left_out & ~(disturbed & (not self._named_points))

    def _counts(self, reference: PointComparison, seen: _Seen, counted: BoolArray) -> dict[str, float]:
        used = counted & np.isfinite(reference.rmsd)
        return {
            "brightness_change": reference.brightness_change,
            "noise_sigma": float(np.sqrt(np.mean(seen.view.noise_variance))) if len(self.points) else 0.0,
            "points_used": float(used.sum()),
            "points_beyond_range": float((used & reference.beyond).sum()),
            "identical_frames": float(seen.repeats),
            "points_fixed_to_camera": float(self.camera_fixed.sum()),
        }

    def _in_metres(self, values: dict[str, float], seen: _Seen, before: _Seen | None) -> dict[str, float]:
        """The errors of position and velocity that the residual motion causes in velocimetry."""
        gsd_m, found = self.config.gsd_m, {}
        if gsd_m and "displacement_reference_px" in values:
            found["position_error_m"] = values["displacement_reference_px"] * gsd_m
        if gsd_m and before is not None and "displacement_previous_px" in values:
            step_ns = seen.arrival.stamp_ns - before.arrival.stamp_ns
            fps = self.config.fps or (1e9 / step_ns if step_ns > 0 else 0.0)
            if fps:
                found["velocity_error_m_s"] = values["displacement_previous_px"] * gsd_m * fps
        return found


def _homologous(measures: ReferenceMeasures, view: View, before: View | None) -> Rmse:
    pair = (before.gray, before.valid, before.fixed_H_ref) if before is not None else (None, None, None)
    return measures.homologous.measure(view.gray, view.valid, *pair, fixed_H_ref=view.fixed_H_ref)


def _rmse_values(rmse: Rmse) -> dict[str, float]:
    named = {"rmse_reference_px": rmse.reference_px, "rmse_previous_px": rmse.previous_px}
    return {"checkpoints": float(rmse.checkpoints)} | {name: px for name, px in named.items() if px is not None}


def _means(points: dict[str, FloatArray], static: BoolArray) -> dict[str, float]:
    """Means over the static points that have a value; medians of the shifts, which are robust to a false peak."""
    found: dict[str, float] = {}
    for name, values in points.items():
        counted = values[static & np.isfinite(values)]
        if len(counted):
            found[name] = float(np.median(counted) if name.startswith("shift") else counted.mean())
    return found


def _revised(metrics: FrameMetrics, static: BoolArray) -> dict[str, float]:
    """The values of a frame, if only the points `static` (n,) count; errors on the ground in proportion."""
    before, means = metrics.values, _means(dict(metrics.points), static)
    found = {name: value for name, value in before.items() if name not in metrics.points} | means
    for ground, name in (("position_error_m", "displacement_reference_px"),
                         ("velocity_error_m_s", "displacement_previous_px")):
        if ground in found:
            scale = means[name] / before[name] if before.get(name) and name in means else 0.0
            found[ground] = before[ground] * scale
    used = static & np.isfinite(metrics.points["rmsd_reference"])
    return found | {"points_used": float(used.sum()),
                    "points_beyond_range": float((used & metrics.beyond).sum())}


def _check_window(frame: Frame, reference_size: tuple[int, int] | None) -> None:
    """Raises InputError for an image that is not of the size of its reference."""
    if reference_size is not None and frame.size != reference_size:
        raise InputError(f"a stabilised picture is {frame.size[0]}x{frame.size[1]} and its homography is for "
                         f"{reference_size[0]}x{reference_size[1]}, they must agree: stabilise without output_roi")
