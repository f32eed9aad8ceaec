"""Every method and every preset against exact truth, speckle, and the graf pictures."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter_ns

import cv2
import graf
import numpy as np
import speckle
from effort import Effort
from scenes import HD, Scene, render
from spread import Spread
from tables import Section, Table, number, verdict
from tqdm import tqdm

from stab_ros.core.geometry import grid, rms_distance
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Track
from stab_ros.estimation.models import nearest
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.parameters.presets import PRESETS
from stab_ros.parameters.table import resolved, stabilizer_config
from stab_ros.tracking.stabilizer import Stabilizer

SCENES = ("kolubara", "alpine")
MANUAL = ("fft_", "ssims", "blender_manual")  # beginnings of the presets whose tool is given its points by hand
PAPER_EXCLUDES_WATER = ("klt_iv",)
BOTH_WAYS = ("vision_fast", "flowvelo_akaze", "ed_ransac", "direct", "ecc")  # without a polygon, and with one
OF_PAPERS_PX, ABOVE_FLOOR_PX = 0.35, 0.1  # the larger of the two
OF_PAPERS = ("fft_cuas", "ssims", "klt_iv", "flowvelo_akaze", "vision_fast", "ed_ransac")
WITHOUT_WATER = ", water excluded"
TARGETS_PX = {"sift": 0.08, f"ecc{WITHOUT_WATER}": 0.015}
_NOTE = ("RMS distance to the truth over the 9x9 grid. Floor: the same of the motion of the row's model nearest to the "
         f"truth. Target of the papers' tools: {OF_PAPERS_PX:g} px, or {ABOVE_FLOOR_PX:g} px above the floor; none is "
         "met with a frame lost: statistics are of the tracked ones. "
         "RMSE: of the points that the fit retained, median; no error, since a threshold bounds it. "
         "Sigma: what the tracker says of its error, in the last frame tracked. Ms: of a track alone, median.")


@dataclass(frozen=True)
class Candidate:
    """Who takes part. name: the row's. method: or preset, which `values`, all parameters that are set, stand for."""

    name: str
    method: str
    values: Mapping[str, Value]

    @staticmethod
    def of(method: str, name: str, values: Mapping[str, Value]) -> Candidate:
        return Candidate(name, method, resolved({"method": method, **values}))

    @property
    def model(self) -> str:
        return stabilizer_config(self.values).model


@dataclass(frozen=True)
class MethodResult:
    """What became of the frames but the reference. error_px: None where lost. floors_px: the least its model can."""

    candidate: Candidate
    scene: str
    tracks: Sequence[Track]
    error_px: Sequence[float | None]
    ms: Sequence[float]
    floors_px: Sequence[float]

    @property
    def floor_px(self) -> float:
        """Median over the frames that were tracked, as that of the errors: those lost may be the hard ones."""
        pairs = zip(self.floors_px, self.error_px, strict=True)
        return Spread.of([floor for floor, error in pairs if error is not None]).median

    @property
    def target_px(self) -> float | None:
        """Of the median; the papers' tools have one with the parameters of the Kolubara, and with the scene's own."""
        if self.candidate.method.removesuffix(f"_{self.scene}") in OF_PAPERS:
            return round(max(OF_PAPERS_PX, self.floor_px + ABOVE_FLOOR_PX), 3)  # 0.35 where the floor is NaN
        return TARGETS_PX.get(self.candidate.name)

    @property
    def error(self) -> Spread:
        return Spread.of([error for error in self.error_px if error is not None])

    @property
    def rmse_px(self) -> float:
        """Of the retained points, as the papers tell it."""
        return Spread.of([track.rmse_px for track in self.tracks if track.rmse_px is not None]).median

    @property
    def sigma_px(self) -> float:
        """Accumulated: of the last frame tracked."""
        return next((track.sigma_px for track in reversed(self.tracks) if track.sigma_px is not None), float("nan"))

    @property
    def lost(self) -> int:
        return sum(error is None for error in self.error_px)


def measure(effort: Effort) -> Section:
    """Flights, then speckle, then graf."""
    tables, data = [], dict[str, object]()
    for name in SCENES:
        outcomes = _of_scene(name, effort.methods)
        tables.append(_table(name, outcomes))
        data[name] = {outcome.candidate.name: _data(outcome) for outcome in outcomes}
    for part in (speckle, graf):
        table, found = part.measure(effort)
        tables.append(table)
        data[part.__name__] = found
    return Section("Methods", tables, data)


def _of_scene(name: str, frames: int) -> list[MethodResult]:
    scene = render(name, HD, frames)
    with tempfile.TemporaryDirectory() as folder:
        mask = Path(folder) / "water.png"
        cv2.imwrite(str(mask), scene.water.astype(np.uint8) * 255)
        outcomes = []
        for candidate in tqdm(list(_candidates(scene, mask)), name, disable=None, leave=False):
            outcomes.append(_outcome(candidate, name, scene))
    return outcomes


def _candidates(scene: Scene, mask: Path) -> list[Candidate]:
    """Presets, then bare methods; those of BOTH_WAYS twice."""
    found = []
    for name in (*PRESETS, *METHODS):
        if name.startswith(MANUAL):
            found.append(_by_hand(name, scene))
        elif not name.startswith(PAPER_EXCLUDES_WATER):
            found.append(Candidate.of(name, name, {}))
        if name.startswith((*PAPER_EXCLUDES_WATER, *BOTH_WAYS)):
            found.append(Candidate.of(name, name + WITHOUT_WATER, {"exclude": str(mask)}))
    return found


def _by_hand(name: str, scene: Scene) -> Candidate:
    """Given as many control points as the preset's paper has, those nearest to the corners first; or all there are."""
    values = PRESETS[name]
    most = next(int(value) for key, value in values.items() if key.endswith(".points"))
    points_px = from_corners(scene.control_points_px, scene.size)[:most]
    given: dict[str, Value] = {"manual_points": json.dumps(points_px.tolist())}
    return Candidate.of(name, f"{name}, {len(points_px)} control points", given)


def from_corners(points_px: FloatArray, size: tuple[int, int]) -> FloatArray:
    """(n, 2) the same points, those nearest to the picture's four corners first."""
    corners = np.array([(x, y) for x in (0, size[0] - 1) for y in (0, size[1] - 1)])
    distance = np.linalg.norm(points_px[None] - corners[:, None], axis=2)
    order = dict.fromkeys([*distance.argmin(axis=1).tolist(), *range(len(points_px))])
    return points_px[list(order)]


def _floors_px(model: str, scene: Scene) -> list[float]:
    """Of each frame but the reference, the distance between the truth and the model's nearest motion."""
    points = grid(scene.size)
    return [rms_distance(nearest(model, H, points), H, scene.size) for H in scene.truth[1:]]


def _outcome(candidate: Candidate, name: str, scene: Scene) -> MethodResult:
    _forget_compiling(make_stabilizer(candidate.values), scene)
    stabilizer = make_stabilizer(candidate.values)
    stabilizer.track(scene.frames[0])
    tracks, errors, times = list[Track](), list[float | None](), list[float]()
    for frame, truth in zip(scene.frames[1:], scene.truth[1:], strict=True):
        start_ns = perf_counter_ns()
        track = stabilizer.track(frame)
        times.append((perf_counter_ns() - start_ns) / 1e6)
        tracks.append(track)
        errors.append(None if track.ref_H_cur is None else rms_distance(track.ref_H_cur, truth, scene.size))
    return MethodResult(candidate, name, tracks, errors, times, _floors_px(candidate.model, scene))


def _forget_compiling(stabilizer: Stabilizer, scene: Scene) -> None:
    """Kernels are compiled on their first frame, which must not count."""
    for frame in scene.frames[:2]:
        stabilizer.track(frame)


def _table(scene: str, outcomes: Sequence[MethodResult]) -> Table:
    head = ("error, px", "median", "floor", "target", "met", "95 %", "max", "lost", "RMSE", "sigma", "ms", "model")
    frames = len(outcomes[0].error_px)
    title = f"{scene}, {frames} frames of {HD[0]}x{HD[1]} against one more, by method and preset"
    return Table(title, head, [_row(outcome) for outcome in outcomes], _NOTE)


def _row(outcome: MethodResult) -> tuple[str, ...]:
    error, candidate = outcome.error, outcome.candidate
    judged = error.median if not outcome.lost else float("inf")
    return (candidate.name, number(error.median, 4), number(outcome.floor_px, 3),
            *verdict(judged, outcome.target_px), number(error.p95, 4), number(error.max, 4), str(outcome.lost),
            number(outcome.rmse_px, 3), number(outcome.sigma_px, 3), number(Spread.of(outcome.ms).median, 1),
            candidate.model)


def _data(outcome: MethodResult) -> dict[str, object]:
    return {"error_px": outcome.error.data(), "lost": outcome.lost,
            "floor_px": None if np.isnan(outcome.floor_px) else outcome.floor_px,
            "target_px": outcome.target_px, "ms": Spread.of(outcome.ms).data(),
            "retained_rmse_px": None if np.isnan(outcome.rmse_px) else outcome.rmse_px,
            "last_sigma_px": None if np.isnan(outcome.sigma_px) else outcome.sigma_px,
            "model": outcome.candidate.model}
