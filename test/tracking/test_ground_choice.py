"""Which plane is the ground, by cues on motions that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.core.geometry import shift
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.tracking.ground_choice import choose_ground
from stab_ros.tracking.ground_cues import Observations
from stab_ros.tracking.planes import Plane

SIZE, FRAMES = (320, 240), 25
ELAPSED_S = np.arange(1, FRAMES + 1) / 25
LATTICE_PX = np.stack(np.meshgrid(np.arange(10.0, 311, 10), np.arange(10.0, 231, 10)), -1).reshape(-1, 2)


def observed(power: FloatArray | None = None) -> Observations:
    return Observations(LATTICE_PX, np.ones(len(LATTICE_PX)) if power is None else power, SIZE, ELAPSED_S)


def moved(member: BoolArray, away_px: FloatArray, at_rest: bool = False) -> Plane:
    """The plane of `member`, (N,) bool, that is (F, 2) px away from its place in the reference."""
    return Plane(member, np.stack([shift(-x, -y) for x, y in away_px]), at_rest)


def in_view(away_px: FloatArray) -> BoolArray:
    """(N,) bool: the features that do not leave the picture, if they move so."""
    at_px = LATTICE_PX + away_px[:, None]
    return np.asarray(np.all((at_px >= 10) & (at_px <= (310, 230)), axis=(0, 2)))


def test_what_has_left_the_picture_is_not_lost() -> None:
    """A gust blows rigid water and a narrow bank out of view; nearest to what is left of the bank was water."""
    sway_px = 6 * np.sin(2 * np.pi * 1.3 * ELAPSED_S)
    of_bank_px = np.stack([-50 * ELAPSED_S, sway_px], -1)
    of_water_px = of_bank_px + ELAPSED_S[:, None] * np.array([220.0, -120.0])
    bank = (LATTICE_PX[:, 0] < 90) & (LATTICE_PX[:, 1] < 60)
    water = moved(~bank & in_view(of_water_px), of_water_px)
    ground = moved(bank & in_view(of_bank_px), of_bank_px)
    choice = choose_ground([water, ground], observed())
    assert choice.ground is ground or [other.plane for other in choice.others] == [ground]


@pytest.mark.parametrize("of_camera_px", [(0.0, 0.0), (0.2, 0.3), (-0.25, 0.1), (0.26, -0.14)])
def test_a_hovering_camera_may_drift_any_way(of_camera_px: tuple[float, float]) -> None:
    """A camera that hovers over two banks beside a river that moves as one."""
    of_water_px = ELAPSED_S[:, None] * np.array([2.6, -1.4])
    river = np.abs(LATTICE_PX[:, 1] - 120) < 60
    banks = moved(~river, ELAPSED_S[:, None] * np.array(of_camera_px), at_rest=True)
    choice = choose_ground([moved(river, of_water_px), banks], observed())
    assert choice.ground is banks
    assert choice.others == ()


def test_features_that_move_alike_are_one_ground() -> None:
    """A codec leaves frames in which no plane is told, and those have parted the features in two groups."""
    away_px = np.stack([3 * np.sin(5 * ELAPSED_S), 2 * np.cos(7 * ELAPSED_S)], -1)
    outer = np.abs(LATTICE_PX - (160, 120)).max(axis=1) > 100
    few = outer & ((LATTICE_PX // 10).sum(axis=1) % 5 == 0)
    many = ~outer & ((LATTICE_PX // 10).sum(axis=1) % 3 > 0)
    choice = choose_ground([moved(many, away_px), moved(few, away_px + 0.02)], observed())
    np.testing.assert_array_equal(choice.ground.member, many | few)
    assert choice.others == ()


def test_ground_of_less_texture_than_glitter_is_ground() -> None:
    """Most features of the banks keep their weak texture; hardly any of the strong ones on the water do."""
    x, y = (LATTICE_PX // 10).astype(int).T
    water = x < 12
    kept_glitter, kept_banks = water & (x % 4 == 1) & (y % 3 == 0), ~water & ((x + y) % 4 > 0)
    power = np.where(water | (x == 12), 3.0, 1.0)  # the waterline is as strong, and does not keep
    ground = moved(kept_banks & (x > 12), ELAPSED_S[:, None] * np.array([4.0, 1.0]))
    glitter = moved(kept_glitter, ELAPSED_S[:, None] * np.array([4.5, 1.8]))
    choice = choose_ground([glitter, ground], observed(power))
    assert choice.ground is ground


@pytest.mark.parametrize("banks_sway", [True, False])
def test_sway_that_both_share_is_the_cameras(banks_sway: bool) -> None:
    """Rigid water flows steadily past banks, and the camera sways; an overlay would not sway with it."""
    sway_px = 0.6 * np.stack([np.sin(2 * np.pi * 1.3 * ELAPSED_S), np.cos(2 * np.pi * 2.1 * ELAPSED_S)], -1)
    river = np.abs(LATTICE_PX[:, 1] - 120) < 60
    water = moved(river, sway_px + ELAPSED_S[:, None] * np.array([20.0, -14.0]))
    banks = moved(~river, sway_px if banks_sway else np.zeros_like(sway_px), at_rest=True)
    choice = choose_ground([water, banks], observed())
    assert (choice.ground is banks and choice.others == ()) == banks_sway
