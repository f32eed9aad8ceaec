"""Which of the disturbances of a river misleads our methods, and whether their sigmas tell: errors by disturbance.

    PYTHONPATH=.:bench .venv/bin/python bench/velocimetry/peers_disturbances.py

Each disturbance of the first river of the comparison by itself, with foam, and all together.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from peers_river import SCENES, SHORE_PX
from tables import Table, number

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.moving_river import RiverFlight
from stab_ros.synthetic.surface import DISTURBED, SurfaceSettings
from stab_ros.velocimetry.lspiv import Lspiv, LspivConfig
from stab_ros.velocimetry.method import Method
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.vectors import Vectors

_FOAM = SurfaceSettings(foam=DISTURBED.foam)
SURFACES: Mapping[str, SurfaceSettings] = {
    "all": DISTURBED,
    "waves": replace(_FOAM, waves=DISTURBED.waves),
    "standing waves": replace(_FOAM, standing_waves=DISTURBED.standing_waves),
    "glint": replace(_FOAM, glint=DISTURBED.glint),
    "bed": replace(_FOAM, bed=DISTURBED.bed, clear_m=DISTURBED.clear_m),
}


def flight_over(surface: SurfaceSettings) -> RiverFlight:
    """The first river of the comparison, seed 1."""
    plain = SCENES[0].flight(seed=1)
    return RiverFlight(plain.preset, plain.field, surface, plain.size, plain.frames, plain.seed)


def measured(method: Method, frames: list[PlacedFrame]) -> Iterator[Vectors]:
    """The vectors of each interval; no mask tells water from ground."""
    for vectors in (*map(method.add, frames), method.finish()):
        if vectors is not None:
            yield vectors


def row(flight: RiverFlight, parts: Iterator[Vectors]) -> list[str]:
    """Vectors off the shore against the velocity midway."""
    errors, sigmas = list[FloatArray](), list[FloatArray]()
    for vectors in parts:
        these = vectors[flight.shore_distance_m(vectors.position_m) > SHORE_PX * flight.gsd_m]
        errors.append(these.velocity_m_s - flight.velocity_m_s(these.position_m, flight.stamp_ns(0)))
        sigmas.append(np.sqrt(np.diagonal(these.total_covariance, axis1=1, axis2=2)))
    error, sigma = np.concatenate(errors), np.concatenate(sigmas)
    return [str(len(error)), number(1e3 * float(np.median(np.linalg.norm(error, axis=1))), 2),
            number(1e3 * float(np.median(sigma)), 2), number(100 * float(np.mean(np.abs(error) < 2 * sigma)), 0)]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=tuple(SURFACES), help="these disturbances alone")
    rows = []
    for name in parser.parse_args().only or SURFACES:
        flight = flight_over(SURFACES[name])
        frames = [PlacedFrame(shot.stamp_ns, shot.image, flight.map_H_image(0), np.zeros((8, 8))) for shot in flight]
        for method in (Lspiv(LspivConfig()), Particles(VelocityConfig())):
            rows.append([name, type(method).__name__.lower(), *row(flight, measured(method, frames))])
    print(Table(SCENES[0].name, ["disturbance", "method", "vectors", "median error, mm/s", "median sigma, mm/s",
                                 "within 2 sigma, %"], rows).text())


if __name__ == "__main__":
    main()
