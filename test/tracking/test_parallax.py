"""A warning where the ground is no plane, with size and direction; none where it is one."""

from __future__ import annotations

import numpy as np
import pytest
from flights import fly
from truth import IDENTITY, SIZE, frame, picture, translation

from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Gray
from stab_ros.io.advice import parallax
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.tracking.parallax import Parallax


def two_heights(along_px: tuple[float, float], height: float) -> Gray:
    """A camera moved by `along_px` over ground whose right half moves `height` times further."""
    x, y = along_px
    low, high = (picture(translation(x * far, y * far)) for far in (1.0, 1.0 + height))
    return np.where(np.arange(SIZE[0]) < SIZE[0] // 2, low, high)


@pytest.mark.parametrize(("direction", "deg"), [((1.0, 0.0), 0.0), ((0.0, 1.0), 90.0), ((0.7, 0.7), 45.0)])
def test_a_step_in_the_ground_is_told_with_its_direction(direction: tuple[float, float], deg: float) -> None:
    stabilizer = make_stabilizer({"start_s": 0.0})
    for number in range(40):
        far = 12 * np.sin(number / 4)
        stabilizer.track(frame(two_heights((direction[0] * far, direction[1] * far), 0.06), number))
    relief = stabilizer.relief
    assert relief is not None
    assert 0.1 < relief.px < 0.6
    assert min(abs(relief.deg - deg), 180 - abs(relief.deg - deg)) < 15
    assert "parallax" in parallax(relief)
    assert "degrees" in parallax(relief)


@pytest.mark.parametrize("name", ["kolubara", "alpine", "basento"])
def test_a_plane_raises_no_alarm(name: str) -> None:
    stabilizer = make_stabilizer({})
    fly(stabilizer, Flight(preset(name), (480, 270), 60))
    assert stabilizer.relief is None


def test_a_cell_of_water_is_no_parallax() -> None:
    """Of which the map says that it is ground, by the bank of a small picture."""
    stabilizer = make_stabilizer({})
    fly(stabilizer, Flight(preset("basento"), (480, 270), 60, seed=6))
    assert stabilizer.relief is None


def test_a_high_bank_raises_the_alarm_in_time_and_then_it_stays() -> None:
    """The upper third of the picture, off by 0.3 px: a warning after a while, and until much less is left."""
    rng, parallax, told = np.random.default_rng(4), Parallax((800, 600)), []
    places = rng.uniform((0, 0), (800, 600), (900, 2))
    for size in [*[0.3] * 30, *[0.0] * 80]:
        off = np.where(places[:, 1:] < 200, [[size * np.cos(0.5), size * np.sin(0.5)]], 0.0)
        parallax.add(*seen(places, off + rng.normal(0, 0.2, places.shape)))
        told.append(parallax.relief)
    assert told[5] is None
    warned = told[29]
    assert warned is not None
    assert abs(warned.deg - np.degrees(0.5)) < 8
    assert told[32] is not None
    assert told[-1] is None


def test_radial_residuals_are_no_parallax() -> None:
    """As a lens that is not known leaves them."""
    rng, parallax = np.random.default_rng(1), Parallax((800, 600))
    places = rng.uniform((0, 0), (800, 600), (1500, 2))
    out = (places - (400, 300)) / 500
    for _ in range(40):
        parallax.add(*seen(places, 0.8 * out * (np.sum(out**2, axis=1, keepdims=True) - 0.4)
                           + rng.normal(0, 0.1, places.shape)))
    assert parallax.relief is None


def test_noise_is_no_parallax_however_strong() -> None:
    rng, parallax = np.random.default_rng(2), Parallax((800, 600))
    places = rng.uniform((0, 0), (800, 600), (600, 2))
    for _ in range(40):
        parallax.add(*seen(places, rng.normal(0, 0.6, places.shape)))
    assert parallax.relief is None


def seen(places_px: FloatArray, off_px: FloatArray) -> tuple[Correspondences, Fit, BoolArray]:
    n = len(places_px)
    pairs = Correspondences(np.arange(n), places_px, places_px - off_px, np.tile(np.eye(2), (n, 1, 1)))
    return pairs, Fit(IDENTITY, np.ones(n, bool), np.zeros((8, 8)), 0.1), np.ones(n, bool)
