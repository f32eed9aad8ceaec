"""Which of the disturbances of a river misleads our methods, and whether their sigmas tell: errors by disturbance.

    PYTHONPATH=.:bench .venv/bin/python bench/velocimetry/peers_disturbances.py

Each disturbance of the first river of the comparison by itself, with foam, and all together. Outliers err by more than
a fifth of the mean speed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from peers_river import SCENES, SHORE_PX
from tables import Table, number

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.moving_river import RiverFlight
from stab_ros.synthetic.surface import DISTURBED, SurfaceSettings
from stab_ros.velocimetry.lspiv import Lspiv
from stab_ros.velocimetry.lspiv_settings import LspivConfig
from stab_ros.velocimetry.method import Method
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.vectors import Vectors

Truth = Callable[[RiverFlight, Vectors], FloatArray]  # (N, 2), m/s
_OUTLIER = 0.2  # of the mean speed
_FOAM = SurfaceSettings(foam=DISTURBED.foam)
SURFACES: Mapping[str, SurfaceSettings] = {
    "all": DISTURBED,
    "waves": replace(_FOAM, waves=DISTURBED.waves),
    "standing waves": replace(_FOAM, standing_waves=DISTURBED.standing_waves),
    "glint": replace(_FOAM, glint=DISTURBED.glint),
    "bed": replace(_FOAM, bed=DISTURBED.bed, clear_m=DISTURBED.clear_m),
}


def flight_over(surface: SurfaceSettings, seed: int) -> RiverFlight:
    """The first river of the comparison."""
    plain = SCENES[0].flight(seed)
    return RiverFlight(plain.preset, plain.field, surface, plain.size, plain.frames, plain.seed)


def measured(method: Method, frames: list[PlacedFrame]) -> Iterator[Vectors]:
    """The vectors of each interval; no mask tells water from ground."""
    for vectors in (*map(method.add, frames), method.finish()):
        if vectors is not None:
            yield vectors


def row(flight: RiverFlight, parts: Iterator[Vectors], truth: Truth) -> list[str]:
    """Vectors off the shore against the truth."""
    errors, sigmas, speeds = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    for vectors in parts:
        these = vectors[flight.shore_distance_m(vectors.position_m) > SHORE_PX * flight.gsd_m]
        true = truth(flight, these)
        errors.append(these.velocity_m_s - true)
        sigmas.append(np.sqrt(np.diagonal(these.total_covariance, axis1=1, axis2=2)))
        speeds.append(np.linalg.norm(true, axis=1))
    error, sigma, size = np.concatenate(errors), np.concatenate(sigmas), np.linalg.norm(np.concatenate(errors), axis=1)
    wrong = size > _OUTLIER * np.concatenate(speeds).mean()
    return [str(len(error)), number(1e3 * float(np.median(size)), 2), number(1e3 * float(np.median(sigma)), 2),
            number(100 * float(np.mean(np.abs(error) < 2 * sigma)), 0), number(100 * float(wrong.mean()), 1)]


def at_its_place(flight: RiverFlight, vectors: Vectors) -> FloatArray:
    """(N, 2), velocity at the places of vectors that stay."""
    return flight.velocity_m_s(vectors.position_m, flight.stamp_ns(0))


def along_its_way(flight: RiverFlight, vectors: Vectors) -> FloatArray:
    """(N, 2), mean velocity of the water that was where each vector starts."""
    true, start_ns = np.empty((len(vectors), 2)), flight.stamp_ns(0)
    for dt_s in np.unique(vectors.dt_s):
        these = vectors.dt_s == dt_s
        true[these] = flight.mean_velocity_m_s(vectors.start_m[these], start_ns, start_ns + round(dt_s * 1e9))
    return true


def dragged(method: Method) -> str:
    """How many of the last interval a bed has dragged along."""
    return str(method.last.dropped["dragged"]) if isinstance(method, Particles) and method.last is not None else "-"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=tuple(SURFACES), help="these disturbances alone")
    parser.add_argument("--seed", type=int, default=1, help="of the flight")
    options, rows = parser.parse_args(), []
    for name in options.only or SURFACES:
        flight = flight_over(SURFACES[name], options.seed)
        frames = [PlacedFrame(shot.stamp_ns, shot.image, flight.map_H_image(0), np.zeros((8, 8))) for shot in flight]
        ways: tuple[tuple[Method, Truth], ...] = ((Lspiv(LspivConfig()), at_its_place),
                                                  (Particles(VelocityConfig()), along_its_way))
        for method, truth in ways:
            found = row(flight, measured(method, frames), truth)
            rows.append([name, type(method).__name__.lower(), *found, dragged(method)])
    print(Table(SCENES[0].name, ["disturbance", "method", "vectors", "median error, mm/s", "median sigma, mm/s",
                                 "within 2 sigma, %", "outliers, %", "dragged, last interval"], rows).text())


if __name__ == "__main__":
    main()
