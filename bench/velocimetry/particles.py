"""Particle tracking against exact truth: errors, and whether each vector's own sigma is true.

    PYTHONPATH=.:bench:test/helpers .venv/bin/python bench/velocimetry/particles.py --seeds odd

Small pictures of a random texture that a known flow moves, by a camera that is still or sways, turns and tilts. The
constants of the method were chosen with even seeds; the published table is of odd ones. Errors are of single vectors
against what was at their start; `ratio` is the median of |error| / sigma relative to that of a normal distribution.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from moving_water import FPS, Water, eddy, moving_camera, parabolic, uniform
from tables import Table, number
from tqdm import tqdm

from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.settings import PRESETS, VelocityConfig

_MEDIAN_OF_NORMAL = 0.6745
_SIZE, _WIDE = (240, 180), (400, 160)
_CAMERA = moving_camera()
_HALVES = {"even": (0, 2), "odd": (1, 3), "fresh": (5,)}
METHODS: dict[str, dict[str, Any]] = {
    "default": {"features": 150}, "klt_iv": {**PRESETS["klt_iv"], "features": 150},
}


@dataclass(frozen=True)
class Case:
    """A scene by its name. duration_s: of the interval."""

    name: str
    water: Water
    duration_s: float = 1.0


def cases() -> list[Case]:
    """The scenes of seed 0; speeds are in px/frame, 25 frames a second."""
    found = [Case(f"uniform {speed:g}", Water(uniform(25 * speed, 0), size=_WIDE if speed > 4 else _SIZE),
                  0.48 if speed > 4 else 1.0) for speed in (0.1, 1, 4, 10)]
    plain = Water(uniform(40, 15))
    found += [Case(f"sharpness {px:g} px", replace(plain, sharpness_px=px)) for px in (3.0, 6.0, 10.0)]
    found += [Case(f"noise {levels:g}", replace(plain, noise=levels)) for levels in (0.5, 1.0, 4.0)]
    found += [Case("contrast 10", replace(plain, contrast=10.0)),
              Case("moving camera", replace(plain, camera_at=_CAMERA)),
              Case("parabolic 2, banks", Water(parabolic(50, 90, 70))),
              Case("parabolic 2, moving camera", Water(parabolic(50, 90, 80), camera_at=_CAMERA)),
              Case("parabolic 4", Water(parabolic(100, 90, 120, banks=False), size=_WIDE), 0.48),
              Case("eddy 0.4 rad/s", Water(eddy(0.4, (120, 90)))),
              Case("texture changes in 3 s", replace(plain, decay_s=3.0)),
              Case("nothing moves, moving camera", Water(uniform(0, 0), camera_at=_CAMERA))]
    return found


@dataclass(frozen=True, eq=False)
class Judged:
    """errors, sigmas: (N, 2), px/s. speeds: (N,) true ones. seeded: features."""

    errors: FloatArray
    sigmas: FloatArray
    speeds: FloatArray
    seeded: int

    @staticmethod
    def of_all(parts: Sequence[Judged]) -> Judged:
        return Judged(np.concatenate([one.errors for one in parts]), np.concatenate([one.sigmas for one in parts]),
                      np.concatenate([one.speeds for one in parts]), sum(one.seeded for one in parts))

    def cells(self) -> list[str]:
        size, ratio = np.linalg.norm(self.errors, axis=1), np.abs(self.errors) / self.sigmas
        mean = float(self.speeds.mean())
        relative = 100 * float(np.median(size)) / mean if mean else float("nan")
        return [str(len(size)), number(100 * len(size) / self.seeded, 0), number(mean, 1),
                number(float(np.median(size)), 3), number(relative, 2), number(float(np.median(self.sigmas)), 3),
                number(100 * float(np.mean(ratio < 2)), 1), number(float(np.median(ratio)) / _MEDIAN_OF_NORMAL, 2)]


def judged(water: Water, duration_s: float, parameters: dict[str, Any]) -> Judged:
    """One interval, rendered and measured."""
    method = Particles(VelocityConfig(**{**parameters, "extract_s": duration_s}), unit="px")
    vectors = None
    for k in range(round(duration_s * FPS) + 1):
        vectors = method.add(water.frame(k / FPS))
    assert vectors is not None
    assert method.last is not None
    true = water.truth(vectors.start_m, vectors.start_ns, vectors.end_ns)
    sigmas = np.sqrt(vectors.covariance[:, [0, 1], [0, 1]])
    return Judged(vectors.velocity_m_s - true, sigmas, np.linalg.norm(true, axis=1), method.last.seeded)


def main() -> None:
    """Prints a table for each method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", choices=_HALVES, default="odd")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--only", default="", help="scenes with this in their name")
    options = parser.parse_args()
    chosen = [case for case in cases() if options.only in case.name]
    for name in options.methods.split(","):
        rows, every = [], []
        for case in tqdm(chosen, name, leave=False, disable=None):
            parts = [judged(replace(case.water, seed=seed), case.duration_s, METHODS[name])
                     for seed in _HALVES[options.seeds]]
            every += parts
            rows.append([case.name, *Judged.of_all(parts).cells()])
        rows.append(["all", *Judged.of_all(every).cells()])
        print(Table(f"`{name}`, {options.seeds} seeds", ["scene", "vectors", "of features, %", "mean speed, px/s",
                                                         "median error, px/s", "% of speed", "median sigma, px/s",
                                                         "within 2 sigma, %", "ratio"], rows).text())
        print(flush=True)


if __name__ == "__main__":
    main()
