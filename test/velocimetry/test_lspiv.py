"""Ensemble correlation against textures that move with a known velocity, under cameras of known motion."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from moving_texture_lspiv import MovingTexture, shear, texture, uniform

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.lspiv import Lspiv
from stab_ros.velocimetry.lspiv_settings import LspivConfig
from stab_ros.velocimetry.vectors import Vectors

SMALL = (160, 128)


def measured(scene: MovingTexture, count: int = 26, config: LspivConfig | None = None) -> Vectors:
    method = Lspiv(config or LspivConfig(interval_s=(count - 1) / scene.fps))
    found = [vectors for vectors in map(method.add, scene.frames(count)) if vectors is not None]
    assert len(found) == 1
    return found[0]


def errors(vectors: Vectors, scene: MovingTexture) -> FloatArray:
    along = scene.flow(vectors.position_m[:, 1])
    return np.asarray(vectors.velocity_m_s - np.stack([along, np.zeros_like(along)], axis=1))


def sigmas(covariance: FloatArray) -> FloatArray:
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


@pytest.mark.parametrize("speed", [0.05, 0.4, -2.0])
def test_a_uniform_flow_is_measured_to_a_thousandth(speed: float) -> None:
    scene = MovingTexture(uniform(speed), SMALL, seed=11)
    vectors = measured(scene)
    assert len(vectors) > 6
    assert np.abs(errors(vectors, scene)).max() < max(1e-3 * abs(speed), 5e-4)


def test_errors_are_as_large_as_their_covariance_says() -> None:
    scene = MovingTexture(uniform(0.4), (320, 256), noise=8.0, seed=100)
    vectors = measured(scene)
    ratio = np.abs(errors(vectors, scene) / sigmas(vectors.covariance))
    assert np.mean(ratio < 2) > 0.9
    assert 0.7 < np.median(ratio) / 0.6745 < 1.3


@pytest.mark.parametrize(("speed", "standing"), [(0.08, 25.0), (0.14, 25.0), (0.32, 50.0), (-0.6, 25.0)])
def test_water_over_a_visible_bed_is_measured_within_its_sigma(speed: float, standing: float) -> None:
    scene = MovingTexture(uniform(speed), SMALL, contrast=12.0, standing=standing, seed=50)
    vectors = measured(scene)
    error = errors(vectors, scene)
    assert len(vectors) > 6
    within = {0.08: 0.45, 0.14: 0.3}.get(speed, 0.03)  # the less the water goes, the more of it goes with the bed
    assert np.median(np.abs(error[:, 0])) < within * abs(speed)
    assert np.mean(np.abs(error) < 2 * sigmas(vectors.covariance)) > 0.9


def test_still_ground_is_not_taken_for_a_bed() -> None:
    scene = MovingTexture(uniform(0.0), SMALL, seed=12)
    vectors = measured(scene)
    assert len(vectors) > 6
    assert np.abs(errors(vectors, scene)).max() < 1e-3


@pytest.mark.parametrize("speed", [0.05, 0.1])
def test_slow_water_without_a_bed_is_not_taken_for_water_over_one(speed: float) -> None:
    """It goes 2.5 and 5 px; with the mean over time a part of it would be taken."""
    scene = MovingTexture(uniform(speed), SMALL, contrast=12.0, seed=51)
    assert np.abs(errors(measured(scene), scene)).max() < 0.03 * speed


def test_shear_within_the_windows_is_followed() -> None:
    scene = MovingTexture(shear(0.2, 0.15), (192, 192), seed=3)
    vectors = measured(scene)
    assert np.median(np.abs(errors(vectors, scene))) < 1e-3


def test_errors_of_homographies_are_shared_and_told() -> None:
    scene = MovingTexture(uniform(0.0), SMALL, shake_px=3.0, sigma_px=0.3, seed=4)
    vectors = measured(scene)
    error = errors(vectors, scene)
    assert np.ptp(error, axis=0).max() < 0.3 * np.abs(error.mean(axis=0)).max() + 1e-3  # the same in all vectors
    assert (np.abs(error) < 3 * sigmas(vectors.total_covariance)).all()
    assert sigmas(vectors.total_covariance).min() > 3 * np.median(sigmas(vectors.covariance))


@pytest.mark.parametrize("frame_px", [12.0, 20.0, -40.0])
def test_the_search_widens_where_water_goes_farther_than_a_quarter_of_a_window(frame_px: float) -> None:
    scene = MovingTexture(uniform(frame_px * 0.02 * 10), (256, 160), fps=10.0, seed=13)
    vectors = measured(scene, 11)
    assert len(vectors) > 6
    assert np.abs(errors(vectors, scene)).max() < 1e-3 * abs(frame_px)
    assert (np.abs(vectors.position_m[:, 0] - 2.56) < 2.56 - 0.48 + abs(frame_px) * 0.01).all()  # half the way is seen


def bank_and_water(speed: float) -> MovingTexture:
    """Fast water between banks that are a quarter of the picture each."""
    return MovingTexture(lambda y: np.where((y > 0.8) & (y < 2.4), speed, 0.0), (256, 160), fps=10.0, seed=14)


WATER = np.array([[0.0, 0.8], [5.12, 0.8], [5.12, 2.4], [0.0, 2.4]])


def test_windows_on_the_shore_are_not_taken_for_water_that_stands() -> None:
    scene = bank_and_water(3.2)
    vectors = next(v for v in map(Lspiv(LspivConfig(interval_s=1.0), water=[WATER]).add, scene.frames(11)) if v)
    assert len(vectors) > 6
    assert np.abs(vectors.velocity_m_s[:, 0] - 3.2).max() < 0.1


def test_where_all_water_is_too_fast_no_bank_is_taken_for_it_and_the_limit_is_told() -> None:
    method = Lspiv(LspivConfig(interval_s=1.0, max_speed_m_s=1.0), water=[WATER])
    found = [len(v) for v in map(method.add, bank_and_water(8.0).frames(11)) if v is not None]
    assert found == [0]
    assert re.search(r"16 of 32 .* up to 1 m/s \(lspiv.max_speed_m_s\), and 16 that stand still", method.doubts["lost"])


@pytest.mark.parametrize(("speed_m_s", "glitter"), [(0.03, 0.5), (0.05, 0.6), (0.2, 0.8)])
def test_slow_water_beside_glitter_that_does_not_last_is_not_taken_for_ground(speed_m_s: float, glitter: float) -> None:
    """Most windows have no peak there, but none goes far."""
    size = (448, 192)
    rng, first = np.random.default_rng(3), round(size[0] * (1 - glitter))
    method = Lspiv(LspivConfig(interval_s=1.0))
    for frame in MovingTexture(uniform(speed_m_s), size, fps=25.0, seed=5, noise=2.0).frames(26):
        gray = frame.gray.copy()
        gray[:, first:] = np.clip(128 + 15 * texture(rng)[: size[1], : size[0] - first], 0, 255)
        vectors = method.add(replace(frame, gray=gray))
    assert vectors is not None
    clear = vectors.position_m[:, 0] < first * 0.02 - 0.64
    assert np.count_nonzero(clear) >= 4
    assert np.abs(vectors.velocity_m_s[clear] - [speed_m_s, 0]).max() < 0.02


def test_nothing_is_measured_where_there_is_nothing_but_noise() -> None:
    scene = MovingTexture(uniform(0.4), SMALL, contrast=0.0, noise=4.0, seed=5)
    method = Lspiv(LspivConfig(interval_s=0.4))
    assert [len(vectors) for vectors in map(method.add, scene.frames(11)) if vectors is not None] == [0]
    assert "8 of 8 windows" in method.doubts["lost"]  # of the others it is less than a grey level


def test_only_windows_in_the_polygons_are_measured() -> None:
    water = np.array([[0.0, 0.0], [3.2, 0.0], [3.2, 1.3], [0.0, 1.3]])
    method = Lspiv(LspivConfig(interval_s=0.4), water=[water])
    scene = MovingTexture(uniform(0.4), SMALL, seed=6)
    found = [vectors for vectors in map(method.add, scene.frames(11)) if vectors is not None]
    assert len(found[0]) > 0
    assert (found[0].position_m[:, 1] <= 1.3 + 1e-9).all()


def test_no_vector_spans_two_epochs_and_ids_are_unique() -> None:
    scene = MovingTexture(uniform(0.4), SMALL, seed=7)
    frames = scene.frames(24)
    other = [type(frame)(frame.stamp_ns, frame.gray, frame.plane_H_image, frame.covariance, epoch=1)
             for frame in frames[12:]]
    method = Lspiv(LspivConfig(interval_s=0.8))
    found = [vectors for vectors in map(method.add, [*frames[:12], *other]) if vectors is not None]
    last = method.finish()
    assert last is not None
    assert [len({*vectors.start_ns.tolist()}) for vectors in [*found, last]] == [1, 1]
    assert found[0].end_ns.max() < last.start_ns.min()
    assert not set(found[0].track_id) & set(last.track_id)


def test_values_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(ConfigError, match="multiple of 4"):
        LspivConfig(window_px=50)
    with pytest.raises(ConfigError, match="1, 2 or 4"):
        LspivConfig(windows_per_side=3)
    frame = MovingTexture(uniform(0.4), (64, 40)).frames(1)[0]
    with pytest.raises(InputError, match="no window of 48 px"):
        Lspiv(LspivConfig()).add(frame)
