"""Flights seen through speckle: what each method makes of multiplicative noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from effort import Effort
from scenes import HD, SEED, Scene, render
from spread import Spread
from tables import Table, number, verdict

from stab_ros.core.geometry import rms_distance
from stab_ros.core.settings import Value
from stab_ros.core.types import Frame
from stab_ros.parameters.engines import make_stabilizer

LOOKS = 4  # equivalent number of
SMALL = (960, 540)
# with the default gates a frame is lost where less than a tenth of the reference's features is found again
WAYS: Mapping[str, Mapping[str, Value]] = {
    "sar_sift": {"method": "sar_sift"},
    "sift": {"method": "sift"},
    "sift, wide gates": {"method": "sift", "min_inliers": 8, "min_inlier_share": 0.0, "max_sigma": 3.0},
}
TARGETS_PX: Mapping[str, float] = {"sar_sift": 0.3}  # Zhang et al. 2023, of their radar video
_NOTE = (f"Intensities of kolubara times gamma noise of {LOOKS} looks (shape {LOOKS}, mean 1, independent by pixel and "
         "frame), clipped to 8 bit; estimator magsac, no polygon. Wide gates: min_inliers 8, "
         "min_inlier_share 0, max_sigma 3.")

Errors = list[float | None]


def measure(effort: Effort) -> tuple[Table, Mapping[str, object]]:
    """Both sizes; the larger one only where there is time."""
    rows, data = [], dict[str, object]()
    for size, frames in zip((SMALL, HD), effort.speckled, strict=True):
        if not frames:
            continue
        scene, name = speckled(render("kolubara", size, frames)), f"{size[0]}x{size[1]}"
        errors = {way: _errors(values, scene) for way, values in WAYS.items()}
        rows += [_row(f"{name}, {way}", way, found) for way, found in errors.items()]
        data[name] = {way: {"error_px": Spread.of(_known(found)).data(), "lost": found.count(None)}
                      for way, found in errors.items()}
    head = ("error, px", "median", "target", "met", "95 %", "max", "frames", "lost")
    return Table(f"Speckle of {LOOKS} looks", head, rows, _NOTE), data


def speckled(scene: Scene) -> Scene:
    """The same scene through speckle."""
    return replace(scene, frames=tuple(_seen(frame, index) for index, frame in enumerate(scene.frames)))


def _seen(frame: Frame, index: int) -> Frame:
    noise = np.random.default_rng([SEED, 70, index]).gamma(LOOKS, 1 / LOOKS, frame.image.shape)
    return replace(frame, image=np.asarray(np.clip(np.round(frame.image * noise), 0, 255), np.uint8))


def _errors(values: Mapping[str, Value], scene: Scene) -> Errors:
    """Of every frame but the reference; None where it was lost."""
    stabilizer = make_stabilizer({**values, "estimator": "magsac"})
    errors: Errors = []
    for frame, truth in zip(scene.frames, scene.truth, strict=True):
        found = stabilizer.track(frame).ref_H_cur
        errors.append(None if found is None else rms_distance(found, truth, scene.size))
    return errors[1:]


def _known(errors: Errors) -> list[float]:
    return [error for error in errors if error is not None]


def _row(name: str, way: str, errors: Errors) -> tuple[str, ...]:
    spread = Spread.of(_known(errors))
    judged = float("inf") if None in errors else spread.median
    return (name, number(spread.median, 3), *verdict(judged, TARGETS_PX.get(way)), number(spread.p95, 3),
            number(spread.max, 3), str(len(errors)), str(errors.count(None)))
