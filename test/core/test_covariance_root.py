"""Square roots of covariances, also of singular and badly scaled ones."""

from __future__ import annotations

import numpy as np

from stab_ros.core.covariance import factor, roots


def test_the_square_of_the_root_is_the_covariance() -> None:
    column = np.array([1e-6, 0, 3, 0, 1, 2, 1e-9, 0])
    rng = np.random.default_rng(0)
    scales = 10.0 ** np.arange(-9, 7, 2)
    full = rng.normal(size=(8, 12)) * scales[:, None]
    for covariance in (np.outer(column, column), full @ full.T, np.zeros((8, 8))):
        root, size = factor(covariance), np.sqrt(np.diag(covariance))
        scale = np.outer(*[np.where(size > 0, size, 1)] * 2)
        np.testing.assert_allclose((root @ root.T) / scale, covariance / scale, atol=1e-12)


def test_symmetric_roots_of_many() -> None:
    half = np.random.default_rng(1).normal(size=(5, 2, 3))
    covariances = np.concatenate([half @ half.transpose(0, 2, 1), np.zeros((1, 2, 2)), np.diag([4.0, 0.0])[None]])
    found = roots(covariances)
    np.testing.assert_allclose(found @ found, covariances, atol=1e-12)
    np.testing.assert_allclose(found, found.transpose(0, 2, 1), atol=1e-12)
    assert (np.linalg.eigvalsh(found) >= -1e-12).all()
