"""Velocities and discharge of synthetic rivers with exact truth, beside the stabilisers of the papers.

    PYTHONPATH=.:bench .venv/bin/python bench/velocimetry/rivers.py --cache /tmp/rivers --seeds 2

The camera moves as the scene's. Each row places the same frames otherwise: by the tracker, by each preset, by the exact
homographies, or by none. Then features are followed by the default of `method: particles` on water and bank. The place
of the first frame in the map is exact. Rendered frames are kept in the cache. The errors are of single vectors against
the mean velocity of the water that was at their start.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tables import Table, number

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, normalized, product_jacobians
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Frame, Gray, Homography, Track
from stab_ros.discharge.cross_section import between
from stab_ros.discharge.measure import measure
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.parameters.presets import PRESETS
from stab_ros.synthetic.moving_river import RiverFlight
from stab_ros.synthetic.river import preset
from stab_ros.synthetic.river_flows import flow_of, section_of
from stab_ros.velocimetry.bank import bank_velocity
from stab_ros.velocimetry.lspiv import Lspiv
from stab_ros.velocimetry.lspiv_settings import LspivConfig
from stab_ros.velocimetry.method import Method
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.shore import off_ground
from stab_ros.velocimetry.vectors import Vectors
from stab_ros.velocimetry.vectors_join import joined
from stab_ros.velocimetry.zone import Zone

_MEDIAN_OF_NORMAL = 0.6745
_HEIGHT_SHARE = {"kolubara": 2160 / 4096, "alpine": 9 / 16, "basento": 9 / 16}
_SECONDS = {"kolubara": 2.0, "alpine": 3.0, "basento": 2.0}
_SCENES = tuple(_SECONDS)
_FLAWLESS, _NONE, _OURS = "exact", "unstabilised", "tracker"
_BANK = VelocityConfig(features=300, local_median=0.0, steadiness=0.0)  # as the product's check of the bank
_BANK_M_PX = 16  # windows on the bank show no water
_SURVEYED, _SEARCH_SHARE = 41, 0.05  # points of the section, and search distance as a share of its length
_GRID_PX = 40
_HEAD = ["frames placed", "lost, %", "unrest, mm/s", "vectors", "mean speed, mm/s", "error along flow, mm/s",
         "median size of it, mm/s", "median size of error, mm/s", "% of mean speed", "median sigma, mm/s",
         "within 2 sigma, %", "ratio", "bank, mm/s", "its sigma", "at rest", "Q, error %", "extrapolated, %",
         "95 %"]


@dataclass(frozen=True, eq=False)
class River:
    """A rendered flight: the truth, and its images (n, h, w) uint8."""

    flight: RiverFlight
    images: Gray

    @staticmethod
    def of(name: str, seed: int, width: int, cache: Path) -> River:
        scene = preset(name)
        size = width, 2 * round(_HEIGHT_SHARE[name] * width / 2 + 0.25)
        frames = round(_SECONDS[name] * scene.fps) + 1
        flight = RiverFlight(scene, flow_of(scene), size=size, frames=frames, seed=seed)
        path = cache / f"{name}_{seed}_{frames}_{width}.npy"
        if not path.exists():
            cache.mkdir(parents=True, exist_ok=True)
            np.save(path, np.array([shot.image for shot in flight]))
        return River(flight, np.load(path))

    def frames(self) -> list[Frame]:
        return [Frame(image, "mono8", self.flight.stamp_ns(k)) for k, image in enumerate(self.images)]

    def ground(self) -> tuple[PlaneMask, PlaneMask]:
        """Water, and the bank so far from it that windows there show none."""
        width, height = self.flight.size
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        map_H_ref = self.flight.map_H_image(0)
        inside_m = self.flight.shore_distance_m(apply(map_H_ref, np.column_stack([x.ravel(), y.ravel()]).astype(float)))
        inside_m = inside_m.reshape(height, width)
        ref_H_map = np.linalg.inv(map_H_ref)
        return (PlaneMask(inside_m > 0, ref_H_map),
                PlaneMask(inside_m < -_BANK_M_PX * self.flight.gsd_m, ref_H_map))


def placements(river: River, name: str) -> tuple[list[PlacedFrame], float]:
    """The frames as placed by `name`, and the share that was lost."""
    flight, n = river.flight, len(river.images)
    if name in (_FLAWLESS, _NONE):
        homographies = [flight.map_H_image(k if name == _FLAWLESS else 0) for k in range(n)]
        return [PlacedFrame(flight.stamp_ns(k), river.images[k], homographies[k], np.zeros((8, 8)))
                for k in range(n)], 0.0
    tracks = _tracked(river, {} if name == _OURS else {"method": name})
    placed = [_placed(river, track) for track in tracks if track.ref_H_cur is not None]
    return placed, 1 - len(placed) / n


def _tracked(river: River, values: Mapping[str, Value]) -> list[Track]:
    stabilizer = make_stabilizer(values)
    return [track for frame in river.frames() for track in stabilizer.answers(frame)] + stabilizer.finish()


def _placed(river: River, track: Track) -> PlacedFrame:
    """By the homography to the reference, whose place in the map is exact."""
    assert track.ref_H_cur is not None
    stamps = [river.flight.stamp_ns(k) for k in range(len(river.images))]
    map_H_ref: Homography = river.flight.map_H_image(stamps.index(track.reference_stamp_ns))
    change = product_jacobians(map_H_ref, track.ref_H_cur)[1]
    covariance = np.zeros((8, 8)) if track.covariance is None else change @ track.covariance @ change.T
    return PlacedFrame(track.stamp_ns, river.images[stamps.index(track.stamp_ns)],
                       normalized(map_H_ref @ track.ref_H_cur), covariance, epoch=track.reset_counter)


def unrest_m_s(river: River, placed: Sequence[PlacedFrame]) -> float:
    """Median size of the velocity that homographies alone give to places on the water that rest, 1 s apart."""
    width, height = river.flight.size
    x, y = np.meshgrid(np.arange(0, width, _GRID_PX), np.arange(0, height, _GRID_PX))
    places_m = apply(river.flight.map_H_image(0), np.column_stack([x.ravel(), y.ravel()]).astype(float))
    places_m = places_m[river.flight.shore_distance_m(places_m) > 0]
    stamps = [river.flight.stamp_ns(k) for k in range(len(river.images))]
    off_m = [frame.to_plane(apply(np.linalg.inv(river.flight.map_H_image(stamps.index(frame.stamp_ns))), places_m))
             - places_m for frame in placed]
    gap = round(river.flight.preset.fps)
    errors = [(off_m[k + gap] - off_m[k]) / ((placed[k + gap].stamp_ns - placed[k].stamp_ns) * 1e-9)
              for k in range(len(placed) - gap)]
    return float(np.median(np.linalg.norm(errors, axis=2))) if errors else float("nan")


def measured(method: Method, frames: Iterable[PlacedFrame]) -> list[Vectors]:
    """The vectors of each interval."""
    found = [vectors for vectors in (method.add(frame) for frame in frames) if vectors is not None]
    last = method.finish()
    return [*found, *([] if last is None else [last])]


@dataclass(frozen=True, eq=False)
class Judged:
    """What was measured in one flight, or in several.

    Attributes:
        errors: (N, 2), along and across the true velocity, m/s.
        sigmas: (N, 2), of the same.
        speeds: (N,), true.
        bank: (I, 2), median velocity of each interval, m/s.
        bank_sigma: (I, 2).
        at_rest: of each interval.
        discharge: (F, 4), of each flight: relative error, lower and upper bound of the interval, by the truth, and the
            share that is extrapolated.
        unrest: of each flight, see `unrest_m_s`.
        lost: share of frames.
    """

    errors: FloatArray
    sigmas: FloatArray
    speeds: FloatArray
    bank: FloatArray
    bank_sigma: FloatArray
    at_rest: Sequence[bool | None]
    discharge: FloatArray
    unrest: FloatArray
    lost: float

    @staticmethod
    def of_all(parts: Sequence[Judged]) -> Judged:
        errors, sigmas, speeds, bank, bank_sigma, discharge, unrest = (
            np.concatenate([getattr(one, key) for one in parts])
            for key in ("errors", "sigmas", "speeds", "bank", "bank_sigma", "discharge", "unrest"))
        return Judged(errors, sigmas, speeds, bank, bank_sigma, [rest for one in parts for rest in one.at_rest],
                      discharge, unrest, float(np.mean([one.lost for one in parts])))

    def cells(self, name: str) -> list[str]:
        along, size, mean = 1e3 * self.errors[:, 0], 1e3 * np.linalg.norm(self.errors, axis=1), 1e3 * self.speeds.mean()
        ratio = np.abs(self.errors) / self.sigmas
        bank, sigma = (1e3 * float(np.sqrt(np.mean(one**2))) for one in (self.bank, self.bank_sigma))
        known = [rest for rest in self.at_rest if rest is not None]
        off, low, high, beyond = self.discharge.T
        inside = int(np.count_nonzero((low <= 1) & (high >= 1)))
        return [name, number(100 * self.lost, 0), number(1e3 * float(np.mean(self.unrest)), 2), str(len(along)),
                number(mean, 0), f"{np.median(along):+.2f}", number(float(np.median(np.abs(along))), 2),
                number(float(np.median(size)), 2),
                number(100 * float(np.median(size)) / mean, 2), number(1e3 * float(np.median(self.sigmas)), 2),
                number(100 * float(np.mean(ratio < 2)), 1), number(float(np.median(ratio)) / _MEDIAN_OF_NORMAL, 2),
                number(bank, 2), number(sigma, 2), f"{sum(known)} of {len(known)}",
                ", ".join(f"{100 * one:+.1f}" for one in off),
                ", ".join(f"{100 * one:.0f}" for one in beyond), f"{inside} of {len(off)}"]


def judged(river: River, name: str, method: str) -> Judged:
    """One flight, placed by `name` and measured."""
    placed, lost = placements(river, name)
    water, bank = river.ground()
    found = [vectors for vectors in measured(_method(method, water), placed) if len(vectors)]
    still = [bank_velocity(vectors, bank) for vectors in measured(Particles(_BANK, bank), placed)]
    parts = [_against_truth(river, vectors, water) for vectors in found]
    errors, sigmas, speeds = (np.concatenate(one) for one in zip(*parts, strict=True))
    return Judged(errors, sigmas, speeds, np.array([one.median_m_s for one in still]),
                  np.array([one.sigma_m_s for one in still]), [one.at_rest for one in still],
                  _discharge(river, _of_flight(found)), np.array([unrest_m_s(river, placed)]), lost)


def _method(name: str, water: PlaneMask) -> Method:
    if name == "lspiv":
        return Lspiv(LspivConfig(), water=Zone(np.linalg.inv(water.mask_H_plane), water.mask).outlines())
    config = VelocityConfig()
    return Particles(config, PlaneMask(off_ground(~water.mask, config.block_px), water.mask_H_plane))


def _against_truth(river: River, vectors: Vectors, water: PlaneMask) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors and sigmas (N, 2) along and across, and true speeds (N,), of what begins on water that moves."""
    vectors = vectors[water.holds(vectors.start_m)]
    true = np.empty((len(vectors), 2))
    for end_ns in np.unique(vectors.end_ns).tolist():
        these = vectors.end_ns == end_ns
        true[these] = river.flight.mean_velocity_m_s(vectors.start_m[these], int(vectors.start_ns[0]), end_ns)
    speeds = np.linalg.norm(true, axis=1)
    moves = speeds > 0
    along = true[moves] / speeds[moves, None]
    axes = np.stack([along, np.column_stack([-along[:, 1], along[:, 0]])], axis=1)
    errors = np.einsum("nij,nj->ni", axes, (vectors.velocity_m_s - true)[moves])
    variance = np.einsum("nij,njk,nik->ni", axes, vectors.total_covariance[moves], axes)
    return errors, np.sqrt(variance), speeds[moves]


def _of_flight(parts: Sequence[Vectors]) -> Vectors:
    """All vectors of a flight; the errors of each interval are columns of its own."""
    columns, first, wide = sum(one.shared.shape[2] for one in parts), 0, []
    for one in parts:
        shared = np.zeros((len(one), 2, columns))
        shared[:, :, first : first + one.shared.shape[2]] = one.shared
        wide.append(replace(one, shared=shared))
        first += one.shared.shape[2]
    return joined(wide)


def _discharge(river: River, vectors: Vectors) -> FloatArray:
    """(1, 4): relative error, the interval by the truth, extrapolated share; alpha, bed and water level are exact."""
    section = section_of(river.flight.preset)
    truth, survey = section.discharge_m3_s(river.flight.field), section.surveyed(_SURVEYED)
    line = between(np.array(section.start_m), np.array(section.end_m), survey.chainage_m, survey.bed_m)
    config = DischargeConfig(alpha_sigma=0.0, wse_sigma_m=0.0, depth_sigma_m=0.0,
                             search_m=_SEARCH_SHARE * section.length_m)
    try:
        found = measure(vectors, line, section.bed.wse_m, config)
    except InputError:
        return np.full((1, 4), np.nan)
    return np.array([[found.q_m3_s / truth - 1, found.low_m3_s / truth, found.high_m3_s / truth,
                      found.shares.extrapolated]])


def names_of(scene: str) -> list[str]:
    """Who places the frames: the presets of other scenes' columns of the paper are left out."""
    others = tuple(f"_{one}" for one in _SCENES if one != scene)
    mine = {name.removesuffix(f"_{scene}") for name in PRESETS if name.endswith(f"_{scene}")}
    return [_OURS, _FLAWLESS, _NONE, *(name for name in PRESETS if not name.endswith(others) and name not in mine)]


def _row(rivers: Sequence[River], name: str, method: str, quick: bool) -> list[str]:
    """quick: only the homographies are judged."""
    if not quick:
        return Judged.of_all([judged(river, name, method) for river in rivers]).cells(name)
    placed = [placements(river, name) for river in rivers]
    unrest = [unrest_m_s(river, frames) for river, (frames, _) in zip(rivers, placed, strict=True)]
    lost = float(np.mean([share for _, share in placed]))
    return [name, number(100 * lost, 0), number(1e3 * float(np.mean(unrest)), 2), *["-"] * (len(_HEAD) - 3)]


def main() -> None:
    """Prints a table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--scenes", nargs="+", choices=_SCENES, default=_SCENES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[2])
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--method", choices=("particles", "lspiv"), default="particles")
    parser.add_argument("--only", nargs="+", help="who places the frames")
    parser.add_argument("--quick", action="store_true", help="of the presets, judge the homographies alone")
    options = parser.parse_args()
    for scene in options.scenes:
        rivers = [River.of(scene, seed, options.width, options.cache) for seed in options.seeds]
        rows = []
        for name in options.only or names_of(scene):
            rows.append(_row(rivers, name, options.method, name in PRESETS and options.quick))
            print(scene, *rows[-1], sep=" | ", file=sys.stderr, flush=True)
        print(Table(f"{scene}, {options.method}, {rivers[0].flight.size[0]}x{rivers[0].flight.size[1]}, "
                    f"{1e3 * rivers[0].flight.gsd_m:.1f} mm/px", _HEAD, rows).text(), flush=True)
        print(flush=True)


if __name__ == "__main__":
    main()
