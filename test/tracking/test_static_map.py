"""The static map as a picture."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.tracking.static_map import StaticMap


@pytest.mark.parametrize("size", [(480, 270), (960, 540), (61, 47), (4, 3)])
def test_a_map_comes_back_from_its_picture(size: tuple[int, int]) -> None:
    width, height = size
    cells = np.random.default_rng(1).integers(0, 256, (-(-height // 4), -(-width // 4)), np.uint8)
    again = StaticMap.of_picture(StaticMap(cells, size).picture())
    assert again.size == size
    np.testing.assert_array_equal(again.cells, cells)


@pytest.mark.parametrize(("share", "divides"), [(0.0, False), (0.5, True), (1.0, False)])
def test_whether_it_tells_ground_from_water(share: float, divides: bool) -> None:
    picture = np.zeros((100, 100), np.uint8)
    picture[: round(100 * share)] = 255
    assert StaticMap.of_picture(picture).divides is divides
