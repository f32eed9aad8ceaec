"""Correlation and information of template matches against independent formulas."""

from __future__ import annotations

import numpy as np

from stab_ros.methods import _cramer_rao


def test_correlation_is_pearsons() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(100, 20, (5, 9, 9)), rng.normal(90, 10, (5, 9, 9))
    b[3] = 7.0
    alike = _cramer_rao.correlation(a, b)
    expected = [np.corrcoef(a[i].ravel(), b[i].ravel())[0, 1] for i in (0, 1, 2, 4)]
    np.testing.assert_allclose(alike[[0, 1, 2, 4]], expected)
    assert alike[3] == 0


def test_an_edge_fixes_one_direction_only() -> None:
    x = np.arange(21.0) - 10
    edge = np.tile(40 * np.tanh(x / 2), (1, 21, 1)) + 0.05 * x[:, None] ** 2
    information = _cramer_rao.information(edge, np.array([0.95]), _cramer_rao.structure(edge), 1.0, np.array([0.0]))
    assert information[0, 0, 0] > 50 * information[0, 1, 1] > 0
