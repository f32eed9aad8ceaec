"""The bank over several intervals."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.velocimetry.bank import BankVelocity
from stab_ros.velocimetry.bank_over_time import over_time, told

NONE = BankVelocity(0, np.full(2, np.nan), np.full((2, 2), np.nan))


def test_intervals_average_by_their_vectors() -> None:
    one = BankVelocity(30, np.array([0.03, 0.0]), np.eye(2) * 1e-4)
    other = BankVelocity(10, np.array([-0.01, 0.04]), np.eye(2) * 4e-4)
    both = over_time([one, NONE, other])
    assert both.count == 40
    np.testing.assert_allclose(both.median_m_s, [0.02, 0.01])
    np.testing.assert_allclose(both.covariance, np.eye(2) * (0.75**2 * 1e-4 + 0.25**2 * 4e-4))


def test_nothing_is_known_of_no_bank() -> None:
    assert (over_time([]).at_rest, over_time([NONE]).at_rest) == (None, None)


@pytest.mark.parametrize(("v_m_s", "words"), [(0.001, "zero within its error bar"), (0.5, "not zero")])
def test_it_is_said(v_m_s: float, words: str) -> None:
    assert words in told(BankVelocity(9, np.array([v_m_s, 0.0]), np.eye(2) * 1e-4), "m")
