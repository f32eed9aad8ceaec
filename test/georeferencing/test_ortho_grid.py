"""The grid of an orthophoto."""

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.georeferencing.ortho_grid import MOST_PIXELS, OrthoGrid


def test_pixel_centres_lie_half_a_pixel_inside_the_corner_and_north_is_up() -> None:
    grid = OrthoGrid(100.0, 250.0, 0.5, 40, 20)
    assert np.allclose(apply(grid.map_H_ortho, np.array([[0.0, 0], [39, 19]])), [[100.25, 249.75], [119.75, 240.25]])
    assert np.allclose(grid.map_H_ortho @ grid.ortho_H_map, np.eye(3), atol=1e-12)


def test_grid_covers_the_outline_on_whole_pixels() -> None:
    outline = np.array([[-3.3, 4.1], [7.7, -2.2], [0, 9.9]])
    grid = OrthoGrid.covering(outline, 0.25)
    assert grid.west_m <= -3.3
    assert grid.west_m + grid.columns * 0.25 >= 7.7
    assert grid.north_m >= 9.9
    assert grid.north_m - grid.rows * 0.25 <= -2.2
    assert (grid.west_m / 0.25, grid.north_m / 0.25) == (-14, 40)


def test_too_many_pixels_are_halved_until_they_fit() -> None:
    grid = OrthoGrid.covering(np.array([[0.0, 0], [2000, 1000]]), 0.02)
    assert grid.resolution_m == 0.16
    assert grid.columns * grid.rows <= MOST_PIXELS < 4 * grid.columns * grid.rows


def test_what_is_no_grid_is_refused() -> None:
    wrong = ((0.0, 0.0, 0.0, 4, 4), (np.nan, 0.0, 1.0, 4, 4), (0.0, 0.0, 1.0, 0, 4), (0.0, 0.0, 1.0, 99_999, 99_999))
    for values in wrong:
        with pytest.raises(InputError, match="orthophoto"):
            OrthoGrid(*values)
