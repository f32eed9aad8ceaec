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


def gradients(field: VelocityField, points_m: FloatArray, time_s: float, arm_m: float) -> FloatArray:
    """Gradient (N, 2, 2) of the velocity, 1/s, row by component and column by direction, by central differences."""
    ahead, behind = (field.velocity_m_s((points_m + side * arm_m * np.eye(2)[:, None]).reshape(-1, 2), time_s)
                     for side in (1, -1))
    return np.asarray((ahead - behind).reshape(2, -1, 2).transpose(1, 2, 0) / (2 * arm_m))


def strain_rates(gradient: FloatArray) -> FloatArray:
    """Rate (N,), 1/s, at which water is drawn out along one direction and pressed along the other, of gradients."""
    along = gradient[:, 0, 0] - gradient[:, 1, 1]
    shear = gradient[:, 0, 1] + gradient[:, 1, 0]
    return np.asarray(np.hypot(along, shear) / 2)


class Paths:
    """Paths of points from a start on; the answer for a time does not depend on what was asked before.

    Between steps a path is the cubic with the velocities at both ends (Hermite).
    """

    def __init__(self, field: VelocityField, points_m: FloatArray, start_s: float, step_s: float) -> None:
        """field: the velocity. points_m: (N, 2) at the start. start_s: since frame 0. step_s: of the integration."""
        self._field, self._origin, self._start_s, self._step_s = field, points_m, start_s, step_s
        self._begin()

    def at(self, time_s: float) -> FloatArray:
        """Where the points (N, 2) are at a time from the start on."""
        steps = (time_s - self._start_s) / self._step_s
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
        time_s = self._start_s + self._step * self._step_s
        self._to_m = runge_kutta(self._field, self._from_m, time_s, self._step_s)
        self._to_velocity = self._field.velocity_m_s(self._to_m, time_s + self._step_s)

    def _between(self, t: float) -> FloatArray:
        """The cubic at a share t of the step."""
        way = self._to_m - self._from_m
        bow = (1 - t) * (self._from_velocity * self._step_s - way) - t * (self._to_velocity * self._step_s - way)
        return np.asarray(self._from_m + t * way + t * (1 - t) * bow)
