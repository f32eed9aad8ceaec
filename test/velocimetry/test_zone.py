"""A region of the reference and the same on the plane."""

from __future__ import annotations

import numpy as np
from velocities import random_vectors

from stab_ros.velocimetry.bank import bank_velocity
from stab_ros.velocimetry.zone import Zone

VECTORS = random_vectors(200)
PLANE_H_REF = np.array([[0.1, 0, 0], [0, -0.1, 10], [0, 0, 1.0]])  # 20 m x 10 m in 200 x 100 pixels


def test_it_holds_vectors_that_begin_and_end_in_it() -> None:
    allowed = np.zeros((101, 201), bool)
    allowed[:, :101] = True  # up to x = 10 m
    held = Zone(PLANE_H_REF, allowed).holds(VECTORS)
    ends_m = np.maximum(VECTORS.start_m[:, 0], VECTORS.end_m[:, 0])
    assert 60 < held.sum() < 140
    assert held[(ends_m < 9.9) & (np.abs(VECTORS.end_m[:, 1] - 5) < 4.9)].all()
    assert not held[ends_m > 10.1].any()


def test_without_a_region_it_holds_all_and_has_no_mask() -> None:
    zone = Zone(PLANE_H_REF)
    assert zone.holds(VECTORS).all()
    assert bank_velocity(VECTORS, zone.mask).count == len(VECTORS)
