"""Beside stabilo and OpenPIV, packages of PyPI: the same frames, frame by frame in turn, so load hits all alike."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np
from effort import Effort
from environment import Child, Package, UnavailableError, running
from lanes import Lane, LaneAnswer, asked, lanes_data, lanes_table, raced
from scenes import HD, Scene, render
from tables import Section

from stab_ros.core.geometry import apply, rms_distance
from stab_ros.core.types import FloatArray
from stab_ros.methods.fft import Fft
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.parameters.table import stabilizer_config

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


def measure(effort: Effort) -> Section:
    """Homographies beside stabilo, points beside OpenPIV."""
    scene = render("kolubara", HD, effort.packages)
    with tempfile.TemporaryDirectory() as folder:
        pictures = Path(folder) / "pictures.npy"
        np.save(pictures, np.stack([frame.image for frame in scene.frames]))
        homographies, points = _beside_stabilo(scene, pictures), _beside_openpiv(scene, pictures)
    title = f"kolubara, {effort.packages} frames of {HD[0]}x{HD[1]}"
    tables = [lanes_table(f"Homographies, {title}", "direct", homographies, _STABILO_NOTE),
              lanes_table(f"Points, {title}", FFT, points, _OPENPIV_NOTE)]
    data = {"homographies": lanes_data(homographies, "direct"), "points": lanes_data(points, FFT)}
    return Section("Packages of PyPI", tables, data)


def _beside_stabilo(scene: Scene, pictures: Path) -> list[Lane]:
    ours = [Lane(method, _tracker(method, scene)) for method in OURS]
    try:
        with running(STABILO, str(pictures)) as child:
            return raced([*ours, Lane(f"stabilo {child.version}", stabilo(child, scene))], len(scene.frames))
    except UnavailableError as why:
        return [*raced(ours, len(scene.frames)), Lane("stabilo", absent=str(why))]


def _beside_openpiv(scene: Scene, pictures: Path) -> list[Lane]:
    method = _fft(scene)
    ours = Lane(FFT, _points(method, scene))
    try:
        with running(OPENPIV, str(pictures)) as child:
            theirs = [Lane(f"OpenPIV {child.version}, {name}", _openpiv(child, how, method.reference_px, scene))
                      for how, name in HOW.items()]
            return raced([ours, *theirs], len(scene.frames))
    except UnavailableError as why:
        return [*raced([ours], len(scene.frames)), Lane("OpenPIV", absent=str(why))]


def _tracker(method: str, scene: Scene) -> Callable[[int], LaneAnswer]:
    stabilizer = make_stabilizer({"method": method})
    stabilizer.track(scene.frames[0])
    return asked(scene, lambda index: stabilizer.track(scene.frames[index]).ref_H_cur)


def stabilo(child: Child, scene: Scene, ms: str = "ms") -> Callable[[int], LaneAnswer]:
    """By the process that knows the same frames by their numbers; `ms` or `with_warp_ms` is the time that counts."""
    def ask(index: int) -> LaneAnswer:
        told = child.ask(index)
        H = np.full((3, 3), np.nan) if told["H"] is None else np.array(told["H"])
        return LaneAnswer(told[ms], [rms_distance(H, scene.truth[index], scene.size)])

    return ask


def _fft(scene: Scene) -> Fft:
    """Our areas, about all control points."""
    reference = scene.frames[0].image
    config: Any = stabilizer_config({"method": "fft_cuas"}).method_config
    return Fft(reference, np.ones(reference.shape, bool), config, scene.control_points_px)


def _points(method: Fft, scene: Scene) -> Callable[[int], LaneAnswer]:
    """Our areas begin where the homography of the frame before puts them."""
    def ask(index: int) -> LaneAnswer:
        start_ns = perf_counter_ns()
        pairs = method.match(scene.frames[index].image, scene.truth[index - 1], np.ones(len(method.reference_px)))
        ms = (perf_counter_ns() - start_ns) / 1e6
        found_px = np.full_like(method.reference_px, np.nan)
        found_px[pairs.feature_id] = pairs.current_px
        return LaneAnswer(ms, _point_errors_px(found_px, method.reference_px, scene, index))

    return ask


def _openpiv(child: Child, how: str, points_px: FloatArray, scene: Scene) -> Callable[[int], LaneAnswer]:
    def ask(index: int) -> LaneAnswer:
        starts_px = apply(np.linalg.inv(scene.truth[index - 1]), points_px)
        told = child.ask({"frame": index, "how": how, "points_px": points_px.tolist(), "starts_px": starts_px.tolist()})
        return LaneAnswer(told["ms"], _point_errors_px(np.array(told["found_px"]), points_px, scene, index))

    return ask


def _point_errors_px(found_px: FloatArray, points_px: FloatArray, scene: Scene, index: int) -> list[float]:
    there = apply(np.linalg.inv(scene.truth[index]), points_px)
    return [float(error) for error in np.linalg.norm(found_px - there, axis=1)]
