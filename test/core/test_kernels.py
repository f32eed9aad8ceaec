"""Kernels: compiled beforehand, for all that comes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numba.core import event
from received import seen

from stab_ros.core.kernels import F64, KERNELS, compile_kernels, filled, kernel, read
from stab_ros.core.settings import Value
from stab_ros.estimation.estimators import ESTIMATORS
from stab_ros.estimation.models import MODELS
from stab_ros.evaluation.evaluator import Arrival
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.warp import INTERPOLATION
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_evaluator, make_stabilizer, reconfigure
from stab_ros.tracking.settings import REFERENCES

ENCODINGS = ("mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8")
LENSES = {"plumb_bob": np.array([-0.2, 0.05, 1e-3, 1e-3, 0.0]), "equidistant": np.array([0.05, 0.0, 0.0, 0.0]),
          "rational_polynomial": np.array([-0.2, 0.05, 0, 0, 0, 0.01, 0, 0.0])}


def flown(values: Mapping[str, Value], encoding: str = "mono8", camera: Camera | None = None,
          size: tuple[int, int] = (320, 240)) -> int:
    """Leads an engine through a start and beyond it, warping every frame; how many were tracked."""
    stabilizer, frames = make_stabilizer(values, camera), [seen(number, encoding, size) for number in range(5)]
    tracks = [track for frame in frames[:4] for track in stabilizer.answers(frame)] + stabilizer.finish()
    tracks.append(stabilizer.track(frames[4]))
    for frame, track in zip(frames, tracks, strict=True):
        stabilizer.warp(frame, track)
    return sum(track.tracked for track in tracks)


INTERPOLATED: list[dict[str, Value]] = [
    {"interpolation": way, "output_scale": scale} for way in INTERPOLATION for scale in (1.0, 0.7, 0.3)]
CASES: list[Mapping[str, Value]] = [
    *({"method": method} for method in METHODS),
    *({"model": model, "estimator": estimator} for model in MODELS for estimator in ESTIMATORS),
    *({"reference": reference} for reference in REFERENCES),
    *INTERPOLATED,
    {"start_s": 0.0}, {"threads": 1}, {"threads": 3}, {"output_roi": "-50, -20, 400, 300"},
]


@pytest.mark.thorough
def test_nothing_is_compiled_once_the_kernels_are() -> None:
    """Whatever the encoding, size, method, model, estimator, reference, interpolation, scale or lens."""
    compile_kernels()
    with event.install_recorder("numba:compile") as compilations:
        for values in CASES:
            flown(values)
        for encoding in ENCODINGS:
            assert flown({}, encoding) == 5
            assert flown({"method": "klt", "output_scale": 0.4}, encoding) == 5
        for size in ((64, 64), (321, 243), (640, 360)):
            flown({}, "bgr8", size=size)
        for model, D in LENSES.items():
            K = np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]])
            flown({"use_camera_info": True}, "mono8", Camera(K, D, model, (320, 240)))
        evaluator = make_evaluator({})
        for number in range(12):
            evaluator.step(Arrival(number, number, np.eye(3), lost=False, frame=seen(number)))
    assert [one.data["dispatcher"].py_func.__name__ for _, one in compilations.buffer] == []


def test_parameters_that_change_compile_nothing() -> None:
    compile_kernels()
    stabilizer = make_stabilizer({"start_s": 0.0})
    stabilizer.track(seen(0))
    with event.install_recorder("numba:compile") as compilations:
        for number, method in enumerate(METHODS, 1):
            reconfigure(stabilizer, {"method": method, "start_s": 0.0, "output_scale": 0.5})
            frame = seen(number % 3)
            stabilizer.warp(frame, stabilizer.track(frame))
    assert not compilations.buffer


def test_memory_of_any_kind_is_taken_and_other_types_are_refused() -> None:
    @kernel((read(F64, 2), filled(F64, 1)))
    def add_up(table: np.ndarray, out: np.ndarray) -> None:
        for row in range(len(table)):
            out[row] = np.sum(table[row])

    KERNELS.remove(add_up)
    table = np.arange(12.0).reshape(3, 4)
    constant = table.copy()
    constant.flags.writeable = False
    for one in (table, constant, np.asfortranarray(table), table[:, ::2], table[::2]):
        out = np.zeros(len(one))
        add_up(one, out)
        assert out.tolist() == one.sum(axis=1).tolist()
    with pytest.raises(TypeError):
        add_up(table.astype(np.float32), np.zeros(3))
    with pytest.raises(TypeError):
        add_up(table, np.zeros(3), 5)
    with pytest.raises(TypeError):  # a copy would be filled in its place
        add_up(table, np.zeros(6)[::2])
