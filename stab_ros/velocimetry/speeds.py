"""Speeds of vectors and their uncertainty, and many vectors as one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.vectors import Unit, Vectors


def speed_m_s(vectors: Vectors) -> FloatArray:
    """(N,), m/s."""
    return np.asarray(np.hypot(*vectors.velocity_m_s.T))


def sigma_speed_m_s(vectors: Vectors) -> FloatArray:
    """(N,) standard deviation of the velocity along itself by all errors, m/s; the larger axis where it is 0."""
    v, total = vectors.velocity_m_s, vectors.total_covariance
    speed = np.hypot(*v.T)
    along = np.einsum("ni,nij,nj->n", v, total, v) / np.where(speed > 0, speed, 1) ** 2
    return np.asarray(np.sqrt(np.maximum(np.where(speed > 0, along, np.linalg.eigvalsh(total)[:, 1]), 0)))


def no_vectors(unit: Unit = "m", shared: int = 0) -> Vectors:
    """None at all. shared: number of common errors."""
    place, whole = np.zeros((0, 2)), np.zeros(0, np.int64)
    return Vectors(place, place, whole, whole, np.zeros((0, 2, 2)), np.zeros((0, 2, shared)), whole, unit)


def joined(parts: Sequence[Vectors], unit: Unit = "m") -> Vectors:
    """The vectors of several intervals of a stream as one. unit: where there are none.

    Raises:
        ValueError: they are in different units, or have different numbers of common errors.
    """
    parts = [part for part in parts if len(part)]
    if not parts:
        return no_vectors(unit)
    if len({(part.unit, part.shared.shape[2]) for part in parts}) > 1:
        raise ValueError("vectors of different units or of different common errors cannot be joined")
    return Vectors(
        np.concatenate([part.start_m for part in parts]), np.concatenate([part.end_m for part in parts]),
        np.concatenate([part.start_ns for part in parts]), np.concatenate([part.end_ns for part in parts]),
        np.concatenate([part.covariance for part in parts]), np.concatenate([part.shared for part in parts]),
        np.concatenate([part.track_id for part in parts]), parts[0].unit)
