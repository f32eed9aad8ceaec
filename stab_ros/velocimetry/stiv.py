"""STIV: velocities along given lines from space-time images (Fujita, Watanabe and Tsubaki 2007).

A line measures the component of the velocity along it, also of water that crosses it at an angle; it does not see
the component across. As a vector the latter is 0, with the standard deviation that the flow's angle to the line is
trusted by: the covariance is `along along^T sigma^2 + across across^T (v tan(angle_sigma_rad))^2`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.georeferencing.horizon import gsd_m, sampled_pixels, shown_well
from stab_ros.velocimetry.intervals import IntervalFrames, IntervalMethod
from stab_ros.velocimetry.lspiv_plane import camera_of
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.shared_errors import ErrorModel, Measured
from stab_ros.velocimetry.sought import lost_doubt
from stab_ros.velocimetry.speeds import no_vectors
from stab_ros.velocimetry.stiv_line import Line, longest_run
from stab_ros.velocimetry.stiv_settings import StivConfig
from stab_ros.velocimetry.stiv_slope import Slope, cleaned, farthest_px_s, slope_of
from stab_ros.velocimetry.vectors import Unit, Vectors
from stab_ros.velocimetry.vectors_join import joined

_MOST_FRAMES = 512  # of an interval that are kept; of more, every second is let go
_LEAST_FRAMES = 10
_LEAST_SAMPLES = 48  # of a line
_FASTEST_PX = 16.0  # per frame, where no speed is given and none beyond fits better


class Stiv(IntervalMethod["_SpaceTimeImages"]):
    """Measures one vector for each line and interval; a `Method`.

    `Vectors.track_id` is the number of the interval times the number of lines, plus that of the line.
    """

    def __init__(self, config: StivConfig, lines: Sequence[FloatArray], unit: Unit = "m") -> None:
        """Starts without frames.

        Args:
            config: how to measure.
            lines: each (2, 2), two points on the plane, downstream from the first to the second; of other directions
                velocities are negative along the line, and the vector is right all the same.
            unit: of the plane.
        """
        super().__init__(config.interval_s)
        self._config, self._ends, self._unit = config, tuple(np.asarray(line, float) for line in lines), unit
        self._intervals = 0

    def begun(self, frame: PlacedFrame) -> _SpaceTimeImages:
        """See `IntervalMethod`.

        Raises:
            InputError: a line is too short or too long for the resolution.
        """
        step = self._config.resolution_m or _median_gsd(frame, self._unit)
        return _SpaceTimeImages([Line.between(ends, step, self._config.rows) for ends in self._ends])

    def again(self, interval: _SpaceTimeImages) -> _SpaceTimeImages:
        """See `IntervalMethod`."""
        return _SpaceTimeImages(interval.lines)

    def measured(self, interval: _SpaceTimeImages) -> Vectors | None:
        """See `IntervalMethod`."""
        if len(interval.stamps_ns) < _LEAST_FRAMES:
            return None
        first_id = self._intervals * len(interval.lines)
        self._intervals += 1
        vectors = interval.measured(self._config, self._unit, first_id)
        self.doubts = interval.doubts
        return vectors


class _SpaceTimeImages(IntervalFrames):
    """The space-time images of an interval.

    doubts: what of them is doubtful, once they are measured; by kind.
    """

    def __init__(self, lines: Sequence[Line]) -> None:
        super().__init__(_MOST_FRAMES)
        self.lines = lines
        ends = [line.place(at) for line in lines for at in (0, line.count - 1)]
        self._model = ErrorModel(np.array(ends).reshape(-1, 2)) if lines else None
        self._rows: list[list[FloatArray]] = []
        self._shown: list[list[BoolArray]] = []
        self.doubts: Mapping[str, str] = {}

    def keep(self, frame: PlacedFrame) -> None:
        seen = [line.seen_by(frame) for line in self.lines]
        self._rows.append([values for values, _ in seen])
        self._shown.append([shown for _, shown in seen])
        if self._model is not None:
            self.errors.append(self._model.of(frame))

    def lists(self) -> tuple[list[Any], ...]:
        return self._rows, self._shown

    def measured(self, config: StivConfig, unit: Unit, first_id: int) -> Vectors:
        """One vector for each line that has a clear slope."""
        parts = [longest_run(np.logical_and.reduce(shown)) for shown in zip(*self._shown, strict=True)]
        long = [i for i, part in enumerate(parts) if part.stop - part.start >= _LEAST_SAMPLES]
        found = [vector for i in long if (vector := self._vector(i, parts[i], config, unit, first_id)) is not None]
        if long:
            self.doubts = self._doubts(config, len(found), len(long), unit)
        return joined(found) if found else no_vectors(unit, self.errors[0].columns if self.errors else 0)

    def _doubts(self, config: StivConfig, found: int, sought: int, unit: Unit) -> Mapping[str, str]:
        step = float(np.median([line.step for line in self.lines]))
        limit_m_s = config.max_speed_m_s or farthest_px_s(self._time_s) * step
        doubt = lost_doubt(sought - found, sought, "lines have no clear slope", "its texture stands still or does not "
                           "last", f"{limit_m_s:.3g} {unit}/s (stiv.max_speed_m_s)")
        return {"lost": doubt} if doubt else {}

    @property
    def _time_s(self) -> FloatArray:
        return (np.array(self.stamps_ns) - self.stamps_ns[0]) * 1e-9

    def _vector(self, i: int, part: slice, config: StivConfig, unit: Unit, first_id: int) -> Vectors | None:
        line, time_s = self.lines[i], self._time_s
        image = cleaned(np.stack([row[i][part] for row in self._rows]))
        fastest_px_s = config.max_speed_m_s / line.step or _FASTEST_PX / float(np.median(np.diff(time_s)))
        slope = slope_of(image, time_s, fastest_px_s, widens=not config.max_speed_m_s)
        if slope is None or slope.correlation < config.min_correlation:
            return None
        return self._as_vector(line, line.place((part.start + part.stop - 1) / 2), slope, config, unit, first_id + i)

    def _as_vector(self, line: Line, middle: FloatArray, slope: Slope, config: StivConfig, unit: Unit,
                   track_id: int) -> Vectors | None:
        if self._model is None:
            return None
        speed = slope.velocity_px_s * line.step
        velocity = speed * line.along
        along, across = np.outer(line.along, line.along), np.outer(line.across, line.across)
        covariance = along * slope.variance_px2_s2 * line.step**2
        covariance = covariance + across * (speed * np.tan(config.angle_sigma_rad)) ** 2
        time_s = np.array(self.stamps_ns) * 1e-9
        dt_s = time_s[slope.pairs[:, 1]] - time_s[slope.pairs[:, 0]]
        half = velocity * float(slope.weights @ dt_s) / 2
        measured = Measured(slope.pairs, slope.weights, dt_s, (middle - half)[None], (middle + half)[None])
        shared = along @ self._model.columns(self.errors, measured, velocity[None], config.clock_sigma,
                                             config.stamp_sigma_s)
        way = velocity * self.duration_s / 2
        return Vectors((middle - way)[None], (middle + way)[None], np.array([self.stamps_ns[0]]),
                       np.array([self.last_ns]), covariance[None], shared, np.array([track_id]), unit)


def _median_gsd(frame: PlacedFrame, unit: Unit) -> float:
    H = (np.diag([1.0, -1.0, 1.0]) if unit == "px" else np.eye(3)) @ frame.plane_H_image
    pixels = shown_well(H, sampled_pixels(camera_of(frame)))
    return float(np.median(gsd_m(H, pixels)))
