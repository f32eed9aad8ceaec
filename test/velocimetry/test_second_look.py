"""Water over a bed that shows through: what is dragged between both is mended or dropped, and counted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from moving_water import FPS, Water, uniform

from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.vectors import Vectors

FRAMES = 21
SPEED_PX_S = np.array([30.0, 8.0])
WATER = Water(uniform(30, 8), size=(200, 140), contrast=14.0, seed=3)


@dataclass(frozen=True, eq=False)
class Clear:
    """Water through which a bed is seen. bed: what it adds, grey levels."""

    water: Water
    bed: FloatArray

    @staticmethod
    def over(water: Water, contrast: float) -> Clear:
        """contrast: of the bed, grey levels."""
        bed = replace(water, flow=uniform(0, 0), contrast=contrast, seed=11, noise=0.0)
        return Clear(water, bed.gray(0.0) - 125.0)

    def frame(self, t: float) -> PlacedFrame:
        plain = self.water.frame(t)
        both = plain.gray.astype(float) + self.bed
        return replace(plain, gray=np.clip(np.round(both), 0, 255).astype(np.uint8))


def measured(scene: Water | Clear) -> tuple[Vectors, Particles]:
    method = Particles(VelocityConfig(extract_s=(FRAMES - 1) / FPS, features=150), unit="px")
    found = [method.add(scene.frame(k / FPS)) for k in range(FRAMES)]
    (vectors,) = (one for one in found if one is not None)
    return vectors, method


def off_px_s(vectors: Vectors) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors.velocity_m_s - SPEED_PX_S, axis=1))


@pytest.mark.thorough
def test_over_a_visible_bed_dragged_features_are_mended_or_dropped() -> None:
    vectors, method = measured(Clear.over(WATER, 12.0))
    error = off_px_s(vectors)
    sigma = np.sqrt(vectors.covariance[:, [0, 1], [0, 1]])
    assert method.last is not None
    assert method.last.dropped["dragged"] > 20
    assert len(vectors) > 30
    assert np.median(error) < 0.03 * np.linalg.norm(SPEED_PX_S)
    assert np.mean(error < 0.2 * np.linalg.norm(SPEED_PX_S)) > 0.95
    assert np.mean(np.abs(vectors.velocity_m_s - SPEED_PX_S) < 2 * sigma) > 0.8


@pytest.mark.thorough
def test_nothing_is_dragged_where_no_bed_is_seen() -> None:
    vectors, method = measured(WATER)
    assert method.last is not None
    assert method.last.dropped["dragged"] == 0
    assert len(vectors) > 130


@pytest.mark.thorough
def test_a_surface_that_changes_is_no_bed() -> None:
    vectors, method = measured(replace(WATER, decay_s=0.6))
    assert method.last is not None
    assert method.last.dropped["dragged"] == 0
    assert np.median(off_px_s(vectors)) < 0.03 * np.linalg.norm(SPEED_PX_S)


@pytest.mark.thorough
def test_water_that_stands_still_over_its_bed_is_kept() -> None:
    still = Clear.over(replace(WATER, flow=uniform(0, 0)), 12.0)
    vectors, method = measured(still)
    assert method.last is not None
    assert method.last.dropped["dragged"] == 0
    assert np.median(np.linalg.norm(vectors.velocity_m_s, axis=1)) < 0.1
