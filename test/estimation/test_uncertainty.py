"""`sigma_px` is neither flattering nor timid, and grows when the pictures get worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from flights import Flown, fly

from stab_ros.core.geometry import apply, jacobian
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Gray
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset

SIZE = (960, 540)
CHI2_2_95 = 5.991


@pytest.fixture(scope="module")
def flights() -> list[Flight]:
    """Some of the kinds of docs/uncertainty.md."""
    return [Flight(replace(preset(name), noise_levels=noise), SIZE, 34, seed)
            for name, noise, seed in (("kolubara", 2.0, 11), ("alpine", 2.0, 12), ("kolubara", 5.0, 14))]


@pytest.mark.thorough
def test_errors_are_as_large_as_sigma_says(flights: list[Flight]) -> None:
    flown = [fly(make_stabilizer({}), flight) for flight in flights]
    ratio = np.concatenate([one.error_px[1:] / one.sigma_px[1:] for one in flown])
    assert np.mean(ratio <= 2) >= 0.93
    assert 0.6 < np.median(ratio) < 1.3
    corners = np.concatenate([corner_chi2(one, flight) for one, flight in zip(flown, flights, strict=True)])
    assert 0.8 < np.mean(corners <= CHI2_2_95) <= 1.0
    assert np.mean(corners <= 1.386) < 0.75  # half of them would be right


def corner_chi2(flown: Flown, flight: Flight) -> FloatArray:
    """How far each corner is off in terms of its own ellipse, squared."""
    (width, height), found = flight.size, []
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1.0]])
    for number, track in flown.tracks.items():
        if number and track.ref_H_cur is not None:
            off = apply(track.ref_H_cur, corners) - apply(flight.ref_H_cur(number), corners)
            J = jacobian(track.ref_H_cur, corners)
            assert track.covariance is not None
            covariance = J @ track.covariance @ J.transpose(0, 2, 1)
            found.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off))
    return np.concatenate(found)


def with_noise(levels: FloatArray | Gray, sigma: float) -> Gray:
    grain = np.random.default_rng(int(levels[:8].sum())).normal(0, sigma, levels.shape)
    return np.asarray(np.clip(levels + grain, 0, 255), np.uint8)


WORSE: dict[str, tuple[Callable[[Gray], Gray], dict[str, Value]]] = {
    "blur": (lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), 2.0)), {}),
    "fog": (lambda image: with_noise(image / 3.5 + 100, 2.0), {}),
    "noise": (lambda image: with_noise(image, 6.0), {}),
    "few features": (lambda image: image, {"direct.patches": 100}),
    "one bank": (lambda image: image, {"exclude": "[[[0, 260], [959, 260], [959, 539], [0, 539]]]"}),
}


@pytest.fixture(scope="module")
def clear(flights: list[Flight]) -> Flown:
    return fly(make_stabilizer({}), flights[0])


@pytest.mark.parametrize("worse", [
    pytest.param(worse, marks=pytest.mark.thorough if worse == "blur" else ()) for worse in WORSE])
def test_sigma_grows_when_the_picture_gets_worse(worse: str, flights: list[Flight], clear: Flown) -> None:
    spoil, values = WORSE[worse]
    worn = fly(make_stabilizer(values), flights[0], lambda number, image: spoil(image) if number else image)
    assert not worn.lost
    after = slice(25, None)  # the start has features of its own
    assert np.median(worn.sigma_px[after]) > 1.15 * np.median(clear.sigma_px[after])
    assert np.median(worn.error_px[after] / worn.sigma_px[after]) < 2.0
