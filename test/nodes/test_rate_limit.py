"""A stream thinned out to a rate by its stamps."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.nodes.rate_limit import RateLimit

MS = 1_000_000


@pytest.mark.parametrize(("rate_hz", "expected"), [(0.0, 300), (100.0, 300), (30.0, 300), (10.0, 100), (7.5, 75)])
@pytest.mark.parametrize("jitter_ms", [0.0, 4.0])
def test_the_mean_rate_is_kept(rate_hz: float, expected: int, jitter_ms: float) -> None:
    jitter = np.random.default_rng(1).uniform(-jitter_ms, jitter_ms, 300)
    stamps = [round((1000 + number * 1000 / 30 + late) * MS) for number, late in enumerate(jitter)]
    limit = RateLimit()
    assert abs(sum(limit.passes(stamp, rate_hz) for stamp in stamps) - expected) <= (20 if rate_hz == 30.0 else 1)


def test_stamps_that_go_back_begin_anew() -> None:
    limit = RateLimit()
    passed = [limit.passes(at * MS, 1.0) for at in (50_000, 50_500, 2_000, 2_500, 3_000)]
    assert passed == [True, False, True, False, True]


def test_a_gap_is_not_made_up_for() -> None:
    limit = RateLimit()
    assert [limit.passes(at * MS, 1.0) for at in (1000, 9000, 9100, 9900, 10_000)] == [True, True, False, False, True]


def test_a_higher_rate_holds_at_once() -> None:
    limit = RateLimit()
    assert [limit.passes(1000 * MS, 0.01), limit.passes(1100 * MS, 10.0)] == [True, True]
