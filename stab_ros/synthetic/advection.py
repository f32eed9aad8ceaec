"""Paths of what drifts with a velocity field, by the classical Runge-Kutta method of fourth order."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.velocity_fields import VelocityField

TRUTH_STEP_S = 0.01


def advected(field: VelocityField, points_m: FloatArray, start_s: float, end_s: float,
             longest_step_s: float = TRUTH_STEP_S) -> FloatArray:
    """Where points drift to.

    Args:
        field: the velocity.
        points_m: (N, 2) east and north at `start_s`.
        start_s: since frame 0.
        end_s: may lie before the start.
        longest_step_s: of the integration.

    Returns:
        (N, 2) at `end_s`.
    """
    steps = max(math.ceil(abs(end_s - start_s) / longest_step_s - 1e-9), 1)
    step_s = (end_s - start_s) / steps
    for k in range(steps):
        points_m = runge_kutta(field, points_m, start_s + k * step_s, step_s)
    return points_m


def runge_kutta(field: VelocityField, points_m: FloatArray, time_s: float, step_s: float) -> FloatArray:
    """Points (N, 2) after one step from `time_s` on."""
    a = field.velocity_m_s(points_m, time_s)
    b = field.velocity_m_s(points_m + step_s / 2 * a, time_s + step_s / 2)
    c = field.velocity_m_s(points_m + step_s / 2 * b, time_s + step_s / 2)
    d = field.velocity_m_s(points_m + step_s * c, time_s + step_s)
    return np.asarray(points_m + step_s / 6 * (a + 2 * b + 2 * c + d))


class Paths:
    """Paths of points from a start on; the answer for a time does not depend on what was asked before.

    Between steps a path is the cubic with the velocities at both ends (Hermite).
    """

    STEP_S = 0.05

    def __init__(self, field: VelocityField, points_m: FloatArray, start_s: float) -> None:
        """field: the velocity. points_m: (N, 2) at the start. start_s: since frame 0."""
        self._field, self._origin, self._start_s = field, points_m, start_s
        self._begin()

    def at(self, time_s: float) -> FloatArray:
        """Where the points (N, 2) are at a time from the start on."""
        steps = (time_s - self._start_s) / self.STEP_S
        if steps < self._step:
            self._begin()
        while self._step + 1 < steps:
            self._advance()
        return self._between(steps - self._step)

    def _begin(self) -> None:
        self._step, self._to_m = -1, self._origin
        self._to_velocity = self._field.velocity_m_s(self._origin, self._start_s)
        self._advance()

    def _advance(self) -> None:
        self._step += 1
        self._from_m, self._from_velocity = self._to_m, self._to_velocity
        time_s = self._start_s + self._step * self.STEP_S
        self._to_m = runge_kutta(self._field, self._from_m, time_s, self.STEP_S)
        self._to_velocity = self._field.velocity_m_s(self._to_m, time_s + self.STEP_S)

    def _between(self, t: float) -> FloatArray:
        """The cubic at a share t of the step."""
        way = self._to_m - self._from_m
        bow = (1 - t) * (self._from_velocity * self.STEP_S - way) - t * (self._to_velocity * self.STEP_S - way)
        return np.asarray(self._from_m + t * way + t * (1 - t) * bow)
