"""Are the sigmas of particles true on the sample flight? Each interval of `V.csv` against the known water.

    .venv/bin/stab-ros stabilize bags/sample.mcap /tmp/still.mcap
    .venv/bin/stab-ros velocity /tmp/still.mcap /tmp/velocity.mcap -p gsd_m:=0.06 --csv /tmp/V.csv
    PYTHONPATH=.:bench:examples .venv/bin/python bench/velocimetry/sample_calibration.py /tmp/V.csv

Where the known water runs at 0.3 m/s or more. `ratio`: median of error / sigma, relative to that of a normal
distribution; `in two dimensions` likewise of the Mahalanobis distance, by the own covariance alone.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from compare_velocities import known_flow, table, vectors
from tables import Table, number

from stab_ros.core.types import FloatArray

_GSD_M, _SIZE, _RUNS_M_S = 0.06, (960, 540), 0.3
_MEDIAN_OF_NORMAL, _MEDIAN_OF_RAYLEIGH = 0.6745, np.sqrt(2 * np.log(2))


def own_covariances(path: Path) -> FloatArray:
    """(n, 2, 2), with y down."""
    of = table(path)
    return np.stack([of["var_vx"], -of["cov_vxvy"], -of["cov_vxvy"], of["var_vy"]], axis=1).reshape(-1, 2, 2)


def cells(error: FloatArray, covariance: FloatArray) -> list[str]:
    """Of errors (n, 2) and covariances (n, 2, 2)."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    ratio = np.abs(error) / sigma
    distance = np.sqrt(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error))
    return [str(len(error)), number(1e3 * float(np.median(np.linalg.norm(error, axis=1))), 1),
            number(1e3 * float(np.median(sigma)), 1), number(100 * float(np.mean(ratio < 2)), 1),
            *(number(float(one) / _MEDIAN_OF_NORMAL, 2) for one in (*np.median(ratio, axis=0), np.median(ratio))),
            number(float(np.median(distance) / _MEDIAN_OF_RAYLEIGH), 2)]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("csv", type=Path)
    parser.add_argument("--truth", type=Path, default=Path("bags/sample_water.csv"))
    options = parser.parse_args()
    place_px, measured = vectors(options.csv, _GSD_M, np.array(_SIZE))
    known, covariance = known_flow(options.truth)(place_px), own_covariances(options.csv)
    start_ns = table(options.csv)["start_ns"]
    runs = np.linalg.norm(known, axis=1) >= _RUNS_M_S
    rows = [[name, *cells((measured - known)[these], covariance[these])] for name, these in (
        *((str(k), runs & (start_ns == start)) for k, start in enumerate(np.unique(start_ns))), ("all", runs))]
    print(Table("sample", ["interval", "vectors", "median error, mm/s", "median sigma, mm/s", "within 2 sigma, %",
                           "ratio of x", "ratio of y", "ratio", "in two dimensions"], rows).text())


if __name__ == "__main__":
    main()
