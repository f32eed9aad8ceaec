"""Space-time images against textures that move with a known velocity."""

from __future__ import annotations

import numpy as np
import pytest
from moving_texture_lspiv import MovingTexture, uniform

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.stiv import Stiv
from stab_ros.velocimetry.stiv_settings import StivConfig
from stab_ros.velocimetry.vectors import Vectors

SIZE = (200, 60)  # px; 4.0 m x 1.2 m
LINES = [np.array([[0.3, y], [3.7, y]]) for y in (0.3, 0.6, 0.9)]


def measured(scene: MovingTexture, lines: list[FloatArray], count: int = 51) -> Vectors | None:
    method = Stiv(StivConfig(interval_s=(count - 1) / scene.fps), lines)
    found = [vectors for vectors in map(method.add, scene.frames(count)) if vectors is not None]
    return found[0] if found else None


@pytest.mark.parametrize(("speed", "standing"), [(0.5, 0.0), (-1.5, 0.0), (0.5, 40.0)])
def test_the_slope_is_the_velocity_also_over_a_standing_pattern(speed: float, standing: float) -> None:
    scene = MovingTexture(uniform(speed), SIZE, standing=standing, contrast=15.0, flicker=0.05, seed=21)
    vectors = measured(scene, LINES)
    assert vectors is not None
    error = vectors.velocity_m_s[:, 0] - speed
    assert len(vectors) == 3
    assert np.abs(error).max() < 3e-3 * abs(speed)
    assert (np.abs(error) < 3 * np.sqrt(vectors.covariance[:, 0, 0])).all()


def test_slow_water_is_not_made_faster_by_what_is_taken_out_with_a_standing_pattern() -> None:
    """It goes five sizes of its texture, and would be 3 % too fast."""
    vectors = measured(MovingTexture(uniform(0.25), SIZE, seed=25), LINES, count=26)
    assert vectors is not None
    error = vectors.velocity_m_s[:, 0] - 0.25
    assert np.abs(error).max() < 0.01 * 0.25
    assert (np.abs(error) < 3 * np.sqrt(vectors.covariance[:, 0, 0])).all()


def test_a_line_against_the_flow_gives_the_same_vector() -> None:
    scene = MovingTexture(uniform(0.5), SIZE, seed=22)
    one, other = (measured(scene, [line]) for line in (LINES[1], LINES[1][::-1].copy()))
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.velocity_m_s, other.velocity_m_s, atol=2e-3)


def test_what_a_line_does_not_see_has_the_uncertainty_of_its_direction() -> None:
    vectors = measured(MovingTexture(uniform(0.5), SIZE, seed=23), LINES[:1])
    assert vectors is not None
    assert vectors.velocity_m_s[0, 1] == 0
    assert np.sqrt(vectors.covariance[0, 1, 1]) == pytest.approx(0.5 * np.tan(0.2), rel=0.01)


def test_ground_that_stands_has_no_slope() -> None:
    vectors = measured(MovingTexture(uniform(0.0), SIZE, seed=24), LINES)
    assert vectors is not None
    assert not len(vectors)


@pytest.mark.parametrize("seed", [25, 26, 27])
def test_the_search_widens_where_water_goes_farther_than_it_reaches(seed: int) -> None:
    """It goes 20 px from frame to frame."""
    vectors = measured(MovingTexture(uniform(4.0), SIZE, fps=10.0, seed=seed), LINES, 21)
    assert vectors is not None
    assert len(vectors) == 3
    assert np.abs(vectors.velocity_m_s[:, 0] - 4.0).max() < 0.01


@pytest.mark.parametrize("seed", [25, 26, 27])
def test_lines_of_water_above_the_limit_have_no_vector_and_the_limit_is_told(seed: int) -> None:
    scene, method = MovingTexture(uniform(4.0), SIZE, fps=10.0, seed=seed), Stiv(
        StivConfig(interval_s=2.0, max_speed_m_s=3.0), LINES)
    assert [len(vectors) for vectors in map(method.add, scene.frames(21)) if vectors is not None] == [0]
    assert "3 of 3 lines have no clear slope up to 3 m/s (stiv.max_speed_m_s)" in method.doubts["lost"]


def test_a_line_that_is_a_point_is_refused() -> None:
    frame = MovingTexture(uniform(0.5), SIZE).frames(1)[0]
    with pytest.raises(InputError, match="a line from"):
        Stiv(StivConfig(), [np.zeros((2, 2))]).add(frame)
