"""Accuracy of the discharge of analytic rivers, and how often the truth lies in the 95 % interval.

    python bench/discharge/coverage.py --draws 100

Each draw has an alpha, a water level, a survey, an error of scale and vectors of its own, as the settings say; "alpha
known" leaves the first out, so that the other sources show. A row per profile of velocity and part of the width that
has vectors.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from stab_ros.discharge.measure import measure
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.settings import DischargeConfig

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test" / "helpers"))

from analytic_river import ALPHA, PROFILES, WIDTH_M, WSE_M, River

_CONFIG = DischargeConfig(draws=400)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--parts", type=float, nargs="+", default=[1.0, 0.667, 0.5])
    options = parser.parse_args()
    draws, parts = options.draws, options.parts
    print("| profile | vectors | error without noise | RMS error | mean sigma | inside | inside, alpha known |")
    print("|---|---|---|---|---|---|---|")
    for name in PROFILES:
        for part in parts:
            print(_row(River(PROFILES[name]), name, part, draws))


def _row(river: River, name: str, part: float, draws: int) -> str:
    quiet = measure(river.vectors(np.random.default_rng(0), 5000, part * WIDTH_M, 0.001, 0.0), river.section(), WSE_M,
                    _CONFIG)
    error = quiet.q_m3_s / river.discharge_m3_s() - 1
    noisy, known = ([_drawn(river, part, seed, config) for seed in range(draws)] for config in
                    (_CONFIG, replace(_CONFIG, alpha_sigma=0.0)))
    off = [found.q_m3_s / truth - 1 for found, truth in noisy]
    sigma = [found.sigma_m3_s / found.q_m3_s for found, _ in noisy]
    inside, inside_known = (sum(found.low_m3_s <= truth <= found.high_m3_s for found, truth in drawn) / draws
                            for drawn in (noisy, known))
    return (f"| {name} | {part:.0%} | {error:+.1%} | {np.sqrt(np.mean(np.square(off))):.1%} | {np.mean(sigma):.1%} | "
            f"{inside:.0%} | {inside_known:.0%} |")


def _drawn(river: River, part: float, seed: int, config: DischargeConfig) -> tuple[Discharge, float]:
    rng = np.random.default_rng(seed)
    alpha = rng.normal(ALPHA, config.alpha_sigma)
    section = river.section(25, config.depth_sigma_m, rng)
    vectors = river.vectors(rng, 1000, part * WIDTH_M)
    found = measure(vectors, section, WSE_M + rng.normal(0, config.wse_sigma_m), replace(config, seed=seed))
    return found, river.discharge_m3_s(alpha)


if __name__ == "__main__":
    main()
