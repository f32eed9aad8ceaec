"""Particle tracking on moving textures with exact truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from moving_water import FPS, Water, moving_camera, parabolic, uniform

from stab_ros.core.types import FloatArray
from stab_ros.imaging.camera import Camera
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.settings import PRESETS, VelocityConfig
from stab_ros.velocimetry.vectors import Vectors

FRAMES = 7
SHORT: dict[str, Any] = {"extract_s": (FRAMES - 1) / FPS, "features": 120}
SIZE = (200, 140)
MOVING = moving_camera(sway_px=8.0, size=SIZE)


def measured(water: Water, frames: int = FRAMES, mask: PlaneMask | None = None, **parameters: Any) -> Vectors:
    method = Particles(VelocityConfig(**{**SHORT, **parameters}), mask, "px")
    found = [method.add(water.frame(k / FPS)) for k in range(frames)]
    (vectors,) = (one for one in found if one is not None)
    return vectors


def errors(water: Water, vectors: Vectors) -> tuple[FloatArray, FloatArray]:
    """Errors (N, 2), px/s, and the same in standard deviations."""
    true = water.truth(vectors.start_m, vectors.start_ns, vectors.end_ns)
    error = vectors.velocity_m_s - true
    return error, error / np.sqrt(vectors.covariance[:, [0, 1], [0, 1]])


@pytest.mark.parametrize("water", [
    Water(uniform(90, -40), size=SIZE), Water(uniform(40, 10), size=SIZE, camera_at=MOVING),
    Water(parabolic(75, 70, 90, banks=False), size=SIZE, camera_at=MOVING),
], ids=["still camera", "moving camera", "sheared, moving camera"])
def test_velocities_are_true_within_their_own_sigma(water: Water) -> None:
    vectors = measured(water)
    error, ratio = errors(water, vectors)
    assert len(vectors) > 60
    assert np.median(np.linalg.norm(error, axis=1)) <= 0.005 * np.linalg.norm(vectors.velocity_m_s, axis=1).mean()
    assert (np.abs(ratio) < 2).mean() >= 0.9
    assert 0.6 <= np.median(np.abs(ratio)) / 0.6745 <= 1.35


def test_sigmas_hold_where_features_are_cut_anew_since_one_texture_fades_into_another() -> None:
    water = Water(uniform(40, 10), size=SIZE, decay_s=0.25, seed=1)  # 138 degrees in the interval, two or three windows
    _, ratio = errors(water, measured(water, 16, extract_s=15 / FPS))
    assert (np.abs(ratio) < 2).mean() >= 0.93  # 0.81 if windows erred independently
    assert 0.7 <= np.median(np.abs(ratio)) / 0.6745 <= 1.3


def test_sigmas_of_slow_water_are_not_too_large() -> None:
    water = Water(uniform(4, 1), size=SIZE)
    _, ratio = errors(water, measured(water, 13, extract_s=12 / FPS))
    assert (np.abs(ratio) < 2).mean() >= 0.9
    assert 0.75 <= np.median(np.abs(ratio)) / 0.6745 <= 1.3


def test_a_scale_on_the_plane_scales_vectors_and_sigmas() -> None:
    still = Water(uniform(50, 0), size=SIZE)
    in_m = replace(still, flow=uniform(0.5, 0), scale=0.01, camera_at=lambda _t: np.diag([0.01, 0.01, 1.0]))
    pixels, metres = measured(still), measured(in_m)
    np.testing.assert_allclose(metres.velocity_m_s, 0.01 * pixels.velocity_m_s, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(metres.covariance, 1e-4 * pixels.covariance, rtol=1e-4)


def test_on_an_orthophoto_north_is_up() -> None:
    map_H_ortho = np.array([[0.01, 0, 10], [0, -0.01, 20], [0, 0, 1]])
    water = Water(uniform(0.5, 0.3), size=SIZE, scale=0.01, camera_at=lambda _t: map_H_ortho)
    vectors = measured(water)
    error, ratio = errors(water, vectors)
    np.testing.assert_allclose(np.median(vectors.velocity_m_s, axis=0), [0.5, 0.3], atol=0.002)
    assert (np.abs(ratio) < 2).mean() >= 0.9
    assert len(error) > 60


def test_the_lens_is_removed_from_the_vectors_not_from_the_image() -> None:
    K = np.array([[160.0, 0, 99.5], [0, 160, 69.5], [0, 0, 1]])
    water = Water(uniform(60, 20), size=SIZE, camera=Camera(K, np.array([-0.12, 0.02, 0, 0, 0]), "plumb_bob", SIZE))
    vectors = measured(water)
    error, ratio = errors(water, vectors)
    assert np.median(np.linalg.norm(error, axis=1)) <= 0.005 * np.hypot(60, 20)
    assert (np.abs(ratio) < 2).mean() >= 0.9


def test_the_paper_tracks_from_frame_to_frame() -> None:
    water = Water(uniform(50, 0), size=SIZE)
    error, ratio = errors(water, measured(water, **{**PRESETS["klt_iv"], **SHORT}))
    assert np.median(np.linalg.norm(error, axis=1)) <= 0.5
    assert (np.abs(ratio) < 2).mean() >= 0.93


def test_features_begin_on_the_water_only_and_one_interval_follows_another() -> None:
    water = Water(uniform(50, 0), size=SIZE)
    mask = PlaneMask.of_polygons([np.array([[40.0, 30], [100, 30], [100, 110], [40, 110]])])
    method = Particles(VelocityConfig(**SHORT), mask)
    found = [method.add(water.frame(k / FPS)) for k in range(2 * FRAMES - 1)]
    first, second = (one for one in found if one is not None)
    assert first.end_ns.max() == second.start_ns.min()
    assert not set(first.track_id) & set(second.track_id)
    for vectors in (first, second):
        assert mask.holds(vectors.start_m).all()


def test_no_vector_spans_two_references_or_a_gap() -> None:
    water = Water(uniform(50, 0), size=SIZE)
    frames = [water.frame(k / FPS) for k in range(4)]
    for other in (replace(water.frame(4 / FPS), epoch=1), water.frame(2.0)):
        method = Particles(VelocityConfig(**{**SHORT, "min_track": 0.3}))
        assert all(method.add(frame) is None for frame in frames)
        vectors = method.add(other)
        assert vectors is not None
        assert vectors.end_ns.max() == frames[-1].stamp_ns
        assert method.finish() is None


def test_a_picture_of_nothing_gives_no_vectors() -> None:
    method = Particles(VelocityConfig(**SHORT))
    flat = np.full((140, 200), 90, np.uint8)
    found = [method.add(PlacedFrame(k * 40_000_000, flat, np.eye(3), np.zeros((8, 8)))) for k in range(FRAMES)]
    (vectors,) = (one for one in found if one is not None)
    assert len(vectors) == 0
    assert method.last is not None
    assert method.last.seeded == 0


def test_the_same_frames_give_the_same_vectors() -> None:
    water = Water(uniform(50, 0), size=SIZE)
    one, other = measured(water, frames=FRAMES), measured(water, frames=FRAMES)
    np.testing.assert_array_equal(one.velocity_m_s, other.velocity_m_s)
    np.testing.assert_array_equal(one.covariance, other.covariance)
