"""Scales that wrong values do not change."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.core.robust import robust_sigma


def test_it_is_the_standard_deviation_of_normal_values_also_where_a_few_are_wrong() -> None:
    values = np.random.default_rng(0).normal([5, -3], [0.2, 4.0], (20000, 2))
    assert robust_sigma(values) == pytest.approx([0.2, 4.0], rel=0.03)
    values[:400] = 1e6
    assert robust_sigma(values) == pytest.approx([0.2, 4.0], rel=0.06)
