"""Random velocity vectors with covariance, for tests of what reads, writes and shows them."""

from __future__ import annotations

import numpy as np

from stab_ros.velocimetry.vectors import Unit, Vectors


def random_vectors(n: int = 20, shared: int = 3, unit: Unit = "m", seed: int = 1, start_ns: int = 10**9) -> Vectors:
    """Vectors over 1 s in a field of 20 x 10, whose numbers need all digits of a double."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, [20, 10], (n, 2))
    own = rng.normal(0, 0.02, (n, 2, 2))
    covariance = own @ own.transpose(0, 2, 1)
    covariance[:, 1, 0] = covariance[:, 0, 1]
    stamps = start_ns + np.arange(n, dtype=np.int64) * 40_000_001
    return Vectors(start, start + rng.normal([0.5, 0.1], 0.05, (n, 2)), stamps, stamps + 999_999_999, covariance,
                   rng.normal(0, 0.01, (n, 2, shared)), np.arange(n, dtype=np.int64) + 2**53, unit)
