"""The evaluator: is a known residual recovered, and does it keep up with a camera on one core."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
from effort import Effort
from scenes import HD, SEED, UHD, render
from tables import Section, Table, number, verdict

from stab_ros.core.geometry import normalized
from stab_ros.core.types import FloatArray, Frame, Gray, Homography
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.evaluation.settings import EvaluatorConfig
from stab_ros.imaging.warp import warp
from stab_ros.metrics.velocity_field import mean_field
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.camera_path import product
from stab_ros.synthetic.flight import Flight, preset

SCENES = ("kolubara", "alpine", "basento")
RESIDUALS_PX = (0.05, 0.2, 0.5, 1.0, 2.0, 4.0)
NOISE_LEVELS = {0.0: (0.15, 0.05), 2.0: (0.20, 0.10)}  # and what the displacement may be off: relative, or in px
FLOORS = ("displacement_reference_px", "displacement_previous_px", "rmse_reference_px", "rmse_previous_px",
          "shift_u_px", "shift_v_px")
CAMERA_MS = 40.0  # 25 frames a second
_DIRECTIONS = np.radians([10, 130, 250])


class _Displaced(Flight):
    """The view of frame 0, displaced by a vector in px."""

    shift_px: FloatArray = np.zeros(2)

    def image_H_plane(self, index: int) -> Homography:
        away = np.array([[1, 0, self.shift_px[0]], [0, 1, self.shift_px[1]], [0, 0, 1.0]])
        return normalized(product(away, super().image_H_plane(index)))


def measure(effort: Effort) -> Section:
    """Recovery on every preset, with and without noise; time a frame at both sizes."""
    tables: list[Table] = []
    data: dict[str, object] = {}
    for name in SCENES:
        found = {noise: _recovered(name, noise) for noise in NOISE_LEVELS}
        tables.append(_recovery_table(name, found))
        data[name] = {str(noise): {str(px): errors for px, errors in rows.items()} for noise, rows in found.items()}
    floors = {name: _floor(name, effort.rendered) for name in SCENES}
    tables.append(_floor_table(floors))
    data["floor"] = floors
    times = {f"{size[0]}x{size[1]}": _times_ms(size, effort.rendered) for size in (HD, UHD)}
    tables.append(_time_table(times))
    return Section("Evaluator", tables, data | {"ms": times})


def _recovered(name: str, noise: float) -> Mapping[float, tuple[float, float]]:
    """For each residual the largest errors of displacement and of the velocity field's regions, px."""
    flight = _Displaced(replace(preset(name), noise_levels=0.0), size=HD, frames=1, seed=SEED)
    evaluator = Evaluator(EvaluatorConfig(rmse_every=1))
    evaluator.step(_arrival(0, _noisy(flight, np.zeros(2), noise, 0)))
    found, index = {}, 0
    for residual_px in RESIDUALS_PX:
        errors = []
        for angle in _DIRECTIONS:
            index += 1
            shift_px = residual_px * np.array([np.cos(angle), np.sin(angle)])
            metrics = evaluator.step(_arrival(index, _noisy(flight, shift_px, noise, index)))
            errors.append(_errors_px(metrics, shift_px))
        worst = np.abs(errors).max(axis=0)
        found[residual_px] = (float(worst[0]), float(worst[1]))
    return found


def _noisy(flight: _Displaced, shift_px: FloatArray, noise: float, index: int) -> Gray:
    flight.shift_px = shift_px
    grain = np.random.default_rng([SEED, 60, index]).normal(0, 1, flight.size[::-1])
    return np.asarray(np.clip(np.round(flight[0].image + noise * grain), 0, 255), np.uint8)


def _errors_px(metrics: FrameMetrics, shift_px: FloatArray) -> tuple[float, float]:
    displacement_px = metrics["displacement_reference_px"]
    regions = [np.hypot(one.u_px - shift_px[0], one.v_px - shift_px[1])
               for one in (metrics.field.regions if metrics.field else ()) if one.vectors]
    return (float("nan") if displacement_px is None else displacement_px - float(np.hypot(*shift_px)),
            max(regions, default=float("nan")))


def _arrival(index: int, gray: Gray, ref_H_cur: Homography | None = None) -> Arrival:
    stamp_ns = 1_000_000_000 + index * 40_000_000
    return Arrival(index, stamp_ns, ref_H_cur, False, Frame(gray, "mono8", stamp_ns))


def _recovery_table(name: str, found: Mapping[float, Mapping[float, tuple[float, float]]]) -> Table:
    head = ("residual, px", *(f"{what}, noise {noise:g}" for noise in found
                              for what in ("displacement off by", "target", "met", "field off by", "target", "met")))
    rows = [(number(px, 2), *(cell for noise, rows in found.items() for cell in _cells(px, noise, rows[px])))
            for px in RESIDUALS_PX]
    return Table(f"{name}, {HD[0]}x{HD[1]}: largest error over {len(_DIRECTIONS)} directions, px", head, rows)


def _cells(residual_px: float, noise: float, errors: Sequence[float]) -> tuple[str, ...]:
    relative, least_px = NOISE_LEVELS[noise]
    field_px = 0.05 if noise == 0 else None
    return (number(errors[0], 3), *verdict(errors[0], max(relative * residual_px, least_px)),
            number(errors[1], 3), *verdict(errors[1], field_px))


def _floor(name: str, count: int) -> Mapping[str, float]:
    """Medians of a flight that was brought back by its exact homographies: what the measures find where nothing is."""
    evaluator, scene = Evaluator(EvaluatorConfig(rmse_every=5)), render(name, HD, count)
    rows = [evaluator.step(_steady(index, frame, truth))
            for index, (frame, truth) in enumerate(zip(scene.frames, scene.truth, strict=True))]
    found = {measure: [value for row in rows if (value := row[measure]) is not None] for measure in FLOORS}
    field = mean_field([row.field for row in rows if row.field is not None])
    lengths = [region.magnitude_px for region in field.regions if region.vectors]
    return {measure: float(np.median(values)) for measure, values in found.items()} | {
        "svf_magnitude_px": max(lengths, default=float("nan"))}


def _steady(index: int, frame: Frame, truth: Homography) -> Arrival:
    steady = replace(frame, image=warp(frame.image, truth, frame.size, "linear", None))
    return Arrival(index, frame.stamp_ns, truth, False, steady)


def _floor_table(floors: Mapping[str, Mapping[str, float]]) -> Table:
    names = next(iter(floors.values()))
    rows = [(name, *(number(found[name], 3) for found in floors.values())) for name in names]
    return Table("What the measures find where nothing moves: medians, of the field's regions the largest",
                 ("brought back by exact homographies, px", *floors), rows)


def _times_ms(size: tuple[int, int], count: int) -> Mapping[str, float]:
    """Medians of a stabilised stream on one core: a frame, a frame with a check, and the mean at every 10th."""
    scene = render("kolubara", size, count)
    stabilizer = make_stabilizer({})
    steps = [stabilizer.step(frame) for frame in scene.frames]
    evaluator = Evaluator(EvaluatorConfig(rmse_every=2))
    plain: list[float] = []
    checked: list[float] = []
    with _one_core():
        for index, (frame, step) in enumerate(zip(scene.frames, steps, strict=True)):
            steady = frame if step.image is None else replace(frame, image=step.image)
            arrival = Arrival(index, frame.stamp_ns, step.track.ref_H_cur, not step.track.tracked, steady)
            started_s = time.perf_counter()
            metrics = evaluator.step(arrival)
            (plain if metrics.field is None else checked).append(1e3 * (time.perf_counter() - started_s))
    frame_ms, check_ms = float(np.median(plain)), float(np.median(checked))
    return {"first frame": plain[0], "frame": frame_ms, "with check": check_ms,
            "mean": 0.9 * frame_ms + 0.1 * check_ms}


@contextmanager
def _one_core() -> Iterator[None]:
    cores, threads = os.sched_getaffinity(0), cv2.getNumThreads()
    os.sched_setaffinity(0, {min(cores)})
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
        cv2.setNumThreads(threads)


def _time_table(times: Mapping[str, Mapping[str, float]]) -> Table:
    rows = [(size, *(number(found[name], 1) for name in ("first frame", "frame", "with check", "mean")),
             *(verdict(found["mean"], CAMERA_MS) if size.startswith(str(HD[0])) else ("", "")))
            for size, found in times.items()]
    return Table("Time on one core, ms", ("mono8", "first frame", "frame", "with check", "mean", "target", "met"), rows,
                 "mean: RMSE of homologous points and velocity field on every 10th frame.")
