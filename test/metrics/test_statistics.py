"""Summaries by hand and against matplotlib's box plot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.cbook import boxplot_stats

from stab_ros.metrics.statistics import summarize


def test_a_summary_by_hand() -> None:
    summary = summarize([4.0, 1.0, 3.0, 2.0, 20.0])
    assert summary is not None
    assert (summary.q1, summary.median, summary.q3) == (2.0, 3.0, 4.0)
    assert (summary.count, summary.mean, summary.max) == (5, 6.0, 20.0)
    assert summary.p95 == pytest.approx(4 + 0.8 * 16)  # 0.95 * 4 = 3.8 intervals along the sorted values
    assert (summary.whisker_low, summary.whisker_high) == (1.0, 4.0)  # up to 4 + 1.5 * 2 = 7
    assert summary.outliers == (20.0,)


def test_a_summary_of_few_values() -> None:
    assert summarize([]) is None
    assert summarize([math.nan, math.nan]) is None
    one = summarize([0.3, math.nan])
    assert one is not None
    assert {one.median, one.p95, one.max, one.mean, one.q1, one.q3, one.whisker_low, one.whisker_high} == {0.3}
    assert (one.count, one.outliers) == (1, ())
    two = summarize([1, 2])
    assert two is not None
    assert (two.q1, two.median, two.q3, two.whisker_low, two.whisker_high) == (1.25, 1.5, 1.75, 1.0, 2.0)


@pytest.mark.parametrize("seed", range(12))
def test_it_is_the_box_plot_of_matplotlib(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.standard_t(1.5, size=int(rng.integers(2, 60)))
    summary, (box,) = summarize(values.tolist()), boxplot_stats(values)
    assert summary is not None
    assert (summary.q1, summary.median, summary.q3, summary.mean, summary.whisker_low, summary.whisker_high
            ) == pytest.approx((box["q1"], box["med"], box["q3"], box["mean"], box["whislo"], box["whishi"]))
    assert summary.outliers == pytest.approx(sorted(box["fliers"]))
