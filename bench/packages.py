"""Beside stabilo and OpenPIV, packages of PyPI: the same frames, frame by frame in turn, so load hits all alike."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np
from effort import Effort
from environment import Child, Package, UnavailableError, running
from scenes import HD, Scene, render
from spread import Spread
from tables import Section, Table, number
from tqdm import tqdm

from stab_ros.core.geometry import apply, rms_distance
from stab_ros.core.parameters import stabilizer_config
from stab_ros.core.types import FloatArray
from stab_ros.io.engine import make_stabilizer
from stab_ros.methods.fft import Fft

_HERE = Path(__file__).resolve().parent
# without kornia and torch, several GB that only its learned detectors need: its default is ORB
STABILO = Package("stabilo", _HERE / "of_stabilo.py", ("numpy", "opencv-python-headless", "PyYAML", "tqdm"))
OPENPIV = Package("openpiv", _HERE / "of_openpiv.py")
OURS = ("direct", "flowvelo_akaze", "akaze", "sift")
FFT = "our fft, fft_cuas"
HOW = {"areas": "extended_search_area_piv", "windef": "window deformation"}
_STABILO_NOTE = ("No polygon. Error: RMS distance to the truth over the 9x9 grid. stabilo as it is set by default, ORB "
                 "at half the size; it runs in a process of its own, which takes its time itself. Times as long: "
                 "median over the frames.")
_OPENPIV_NOTE = ("Ground control points, areas of 32, then 16 px, which begin where the point was in the frame before. "
                 "Ours measures 3x3 vectors in the first pass and the point in the second; window deformation fields "
                 "of 5x5 and 11x11. Error: of every point in every frame. Ms: of all points of a frame.")


@dataclass(frozen=True)
class Answer:
    """What one way said of one frame. errors_px: one for each thing asked, NaN where lost."""

    ms: float
    errors_px: Sequence[float]


@dataclass(frozen=True)
class Lane:
    """One way, and what it said by frame; or why there is none of it."""

    name: str
    ask: Callable[[int], Answer] | None = None
    absent: str = ""
    answers: dict[int, Answer] = field(default_factory=dict)

    @property
    def ms(self) -> Spread:
        return Spread.of([answer.ms for answer in self.answers.values()])

    @property
    def errors_px(self) -> list[float]:
        return [error for answer in self.answers.values() for error in answer.errors_px]

    @property
    def error(self) -> Spread:
        return Spread.of([error for error in self.errors_px if np.isfinite(error)])

    def times_as_long(self, other: Lane) -> float:
        """Median over the frames that both saw."""
        both = self.answers.keys() & other.answers.keys()
        return Spread.of([self.answers[k].ms / other.answers[k].ms for k in both]).median


def measure(effort: Effort) -> Section:
    """Homographies beside stabilo, points beside OpenPIV."""
    scene = render("kolubara", HD, effort.packages)
    with tempfile.TemporaryDirectory() as folder:
        pictures = Path(folder) / "pictures.npy"
        np.save(pictures, np.stack([frame.image for frame in scene.frames]))
        homographies, points = _beside_stabilo(scene, pictures), _beside_openpiv(scene, pictures)
    title = f"kolubara, {effort.packages} frames of {HD[0]}x{HD[1]}"
    tables = [_table(f"Homographies, {title}", "direct", homographies, _STABILO_NOTE),
              _table(f"Points, {title}", FFT, points, _OPENPIV_NOTE)]
    data = {"homographies": _data(homographies, "direct"), "points": _data(points, FFT)}
    return Section("Packages of PyPI", tables, data)


def _beside_stabilo(scene: Scene, pictures: Path) -> list[Lane]:
    ours = [Lane(method, _tracker(method, scene)) for method in OURS]
    try:
        with running(STABILO, str(pictures)) as child:
            return _raced([*ours, Lane(f"stabilo {child.version}", _stabilo(child, scene))], len(scene.frames))
    except UnavailableError as why:
        return [*_raced(ours, len(scene.frames)), Lane("stabilo", absent=str(why))]


def _beside_openpiv(scene: Scene, pictures: Path) -> list[Lane]:
    method = _fft(scene)
    ours = Lane(FFT, _points(method, scene))
    try:
        with running(OPENPIV, str(pictures)) as child:
            theirs = [Lane(f"OpenPIV {child.version}, {name}", _openpiv(child, how, method.reference_px, scene))
                      for how, name in HOW.items()]
            return _raced([ours, *theirs], len(scene.frames))
    except UnavailableError as why:
        return [*_raced([ours], len(scene.frames)), Lane("OpenPIV", absent=str(why))]


def _raced(lanes: list[Lane], frames: int) -> list[Lane]:
    """Every frame but the reference through all lanes in turn; the first frame twice, since the first time compiles."""
    present = [lane for lane in lanes if lane.ask is not None]
    for index in tqdm([1, *range(1, frames)], "packages", disable=None, leave=False):
        first = index % len(present)
        for lane in present[first:] + present[:first]:
            assert lane.ask is not None
            lane.answers[index] = lane.ask(index)
    return lanes


def _tracker(method: str, scene: Scene) -> Callable[[int], Answer]:
    stabilizer = make_stabilizer({"method": method})
    stabilizer.track(scene.frames[0])

    def ask(index: int) -> Answer:
        start_ns = perf_counter_ns()
        H = stabilizer.track(scene.frames[index]).ref_H_cur
        ms = (perf_counter_ns() - start_ns) / 1e6
        return Answer(ms, [float("nan") if H is None else rms_distance(H, scene.truth[index], scene.size)])

    return ask


def _stabilo(child: Child, scene: Scene) -> Callable[[int], Answer]:
    def ask(index: int) -> Answer:
        told = child.ask(index)
        H = np.full((3, 3), np.nan) if told["H"] is None else np.array(told["H"])
        return Answer(told["ms"], [rms_distance(H, scene.truth[index], scene.size)])

    return ask


def _fft(scene: Scene) -> Fft:
    """Our areas, about all control points."""
    reference = scene.frames[0].image
    config: Any = stabilizer_config({"method": "fft_cuas"}).method_config
    return Fft(reference, np.ones(reference.shape, bool), config, scene.control_points_px)


def _points(method: Fft, scene: Scene) -> Callable[[int], Answer]:
    """Our areas begin where the homography of the frame before puts them."""
    def ask(index: int) -> Answer:
        start_ns = perf_counter_ns()
        pairs = method.match(scene.frames[index].image, scene.truth[index - 1], np.ones(len(method.reference_px)))
        ms = (perf_counter_ns() - start_ns) / 1e6
        found_px = np.full_like(method.reference_px, np.nan)
        found_px[pairs.feature_id] = pairs.current_px
        return Answer(ms, _point_errors_px(found_px, method.reference_px, scene, index))

    return ask


def _openpiv(child: Child, how: str, points_px: FloatArray, scene: Scene) -> Callable[[int], Answer]:
    def ask(index: int) -> Answer:
        starts_px = apply(np.linalg.inv(scene.truth[index - 1]), points_px)
        told = child.ask({"frame": index, "how": how, "points_px": points_px.tolist(), "starts_px": starts_px.tolist()})
        return Answer(told["ms"], _point_errors_px(np.array(told["found_px"]), points_px, scene, index))

    return ask


def _point_errors_px(found_px: FloatArray, points_px: FloatArray, scene: Scene, index: int) -> list[float]:
    there = apply(np.linalg.inv(scene.truth[index]), points_px)
    return [float(error) for error in np.linalg.norm(found_px - there, axis=1)]


def _table(title: str, beside: str, lanes: Sequence[Lane], note: str) -> Table:
    base = next(lane for lane in lanes if lane.name == beside)
    head = ("", "error median, px", "95 %", "max", "lost", "ms median", "95 %", f"times as long as {beside}", "remark")
    return Table(title, head, [_row(lane, base) for lane in lanes], note)


def _row(lane: Lane, base: Lane) -> tuple[str, ...]:
    if lane.absent:
        return (lane.name, *("" for _ in range(7)), f"not to be had: {lane.absent}")
    lost = len(lane.errors_px) - lane.error.count
    ratio = "" if lane is base else number(lane.times_as_long(base), 2)
    return (lane.name, number(lane.error.median, 4), number(lane.error.p95, 4), number(lane.error.max, 4), str(lost),
            number(lane.ms.median, 2), number(lane.ms.p95, 2), ratio, "")


def _data(lanes: Sequence[Lane], beside: str) -> Mapping[str, object]:
    base = next(lane for lane in lanes if lane.name == beside)
    return {lane.name: {"absent": lane.absent} if lane.absent else
            {"error_px": lane.error.data(), "lost": len(lane.errors_px) - lane.error.count, "ms": lane.ms.data(),
             "times_as_long": lane.times_as_long(base)} for lane in lanes}
