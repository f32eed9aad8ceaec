"""How exact the engine is over synthetic flights with known truth: noise, changing light, moving water."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import FloatArray, Frame, Track
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, Shot, preset

SIZE = (960, 540)
FRAMES = 12


@dataclass(frozen=True, eq=False)
class Result:
    """Of every frame after the reference: distance from the truth over the 9x9 grid, and the sigma claimed, px."""

    error_px: FloatArray
    sigma_px: FloatArray

    @property
    def median_px(self) -> float:
        return float(np.median(self.error_px))

    @property
    def p95_px(self) -> float:
        return float(np.percentile(self.error_px, 95))


@pytest.fixture(scope="module", params=["kolubara", "alpine"])
def shots(request: pytest.FixtureRequest) -> list[Shot]:
    """Twelve grey frames over a river with moving water."""
    return list(Flight(preset(request.param), size=SIZE, frames=FRAMES, seed=1))


@pytest.fixture(scope="module")
def water(shots: list[Shot], tmp_path_factory: pytest.TempPathFactory) -> str:
    """The water of the reference as a mask, a little more than that."""
    path = tmp_path_factory.mktemp("water") / "water.png"
    grown = cv2.dilate(shots[0].water.astype(np.uint8) * 255, np.ones((17, 17), np.uint8))
    if not cv2.imwrite(str(path), grown):
        raise InputError(f"{path}: cannot be written")
    return str(path)


def flown(shots: list[Shot], **values: str) -> Result:
    stabilizer = make_stabilizer({name.replace("__", "."): value for name, value in values.items()})
    tracks: list[Track] = [stabilizer.track(Frame(shot.image, "mono8", shot.stamp_ns)) for shot in shots]
    assert all(track.tracked for track in tracks)
    found = [(track.ref_H_cur, track.sigma_px, shot.ref_H_cur) for track, shot in zip(tracks, shots, strict=True)][1:]
    errors = [rms_distance(H, truth, SIZE) for H, _, truth in found if H is not None]
    return Result(np.array(errors), np.array([sigma for _, sigma, _ in found]))


def test_the_camera_really_moves(shots: list[Shot]) -> None:
    assert max(rms_distance(shot.ref_H_cur, np.eye(3), SIZE) for shot in shots) > 0.5


def test_direct_without_any_polygon(shots: list[Shot]) -> None:
    result = flown(shots)
    assert result.median_px <= 0.02
    assert result.p95_px <= 0.1


def test_direct_with_the_water_left_out(shots: list[Shot], water: str) -> None:
    result = flown(shots, exclude=water)
    assert result.median_px <= 0.012
    assert result.p95_px <= 0.02


def test_klt(shots: list[Shot]) -> None:
    assert flown(shots, method="klt").median_px <= 0.15


@pytest.mark.parametrize("estimator", ["ransac", "lo_ransac", "lmeds"])
def test_other_robust_estimators_are_as_exact(shots: list[Shot], water: str, estimator: str) -> None:
    assert flown(shots, exclude=water, estimator=estimator).median_px <= 0.015


def test_halves_of_the_patches_agree_within_what_they_claim(shots: list[Shot], water: str) -> None:
    for half in ("even", "odd"):
        assert flown(shots, exclude=water, direct__subset=half).median_px <= 0.02


def test_claimed_sigma_is_of_the_size_of_the_error(shots: list[Shot], water: str) -> None:
    result = flown(shots, exclude=water)
    assert 1 / 2 < np.sqrt(np.mean(result.error_px**2)) / np.median(result.sigma_px) < 6
