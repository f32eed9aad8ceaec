"""Textures that repeat: they are told from others, and no wrong repetition is taken for the right one."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from moving_texture_lspiv import MovingTexture, ripples, texture, uniform

from stab_ros.core.types import FloatArray, Gray
from stab_ros.velocimetry.dropped import bed_doubt
from stab_ros.velocimetry.lspiv import Lspiv
from stab_ros.velocimetry.lspiv_settings import LspivConfig
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.repeating import usual_period_px
from stab_ros.velocimetry.settings import VelocityConfig

FEATURES_PX = np.stack(np.meshgrid(np.arange(40.0, 220, 20), np.arange(40.0, 220, 20)), axis=-1).reshape(-1, 2)
FAST = MovingTexture(uniform(2.4), (320, 200), fps=10.0, wave_px=16.0, seed=3)  # 12 of 16 px from frame to frame


def seen(one: FloatArray) -> Gray:
    return np.clip(128 + 25 * one[:256, :256], 0, 255).astype(np.uint8)


@pytest.mark.parametrize("wave_px", [10.0, 16.0, 20.0])
def test_waves_have_the_period_of_their_length(wave_px: float) -> None:
    gray = seen(ripples(np.random.default_rng(1), wave_px))
    assert usual_period_px(gray, FEATURES_PX) == pytest.approx(wave_px, abs=1)


@pytest.mark.parametrize("smooth_px", [0.7, 1.5, 3.0, 6.0])
def test_random_texture_does_not_repeat(smooth_px: float) -> None:
    assert np.isinf(usual_period_px(seen(texture(np.random.default_rng(2), smooth_px)), FEATURES_PX))


def test_edges_do_not_repeat() -> None:
    """Each shift along one looks alike."""
    gray = np.full((256, 256), 90, np.uint8)
    for x in range(0, 256, 60):
        cv2.line(gray, (x, 0), (x + 90, 256), 200, 6)
    assert np.isinf(usual_period_px(gray, FEATURES_PX))


@pytest.mark.parametrize("limit_m_s", [0.0, 3.0])
def test_windows_do_not_go_to_the_wrong_wave(limit_m_s: float) -> None:
    """The shift of the wrong wave, -4 px, is in the range at first, that of the right one on its border."""
    method = Lspiv(LspivConfig(interval_s=1.0, max_speed_m_s=limit_m_s))
    (vectors,) = (one for one in map(method.add, FAST.frames(11)) if one is not None)
    assert np.abs(vectors.velocity_m_s - [2.4, 0]).max(initial=0) < 0.02
    assert re.search(r"differ by 3.[12] m/s look alike; lspiv.max_speed_m_s", method.doubts["repeats"])


def test_windows_of_slow_waves_are_measured() -> None:
    method = Lspiv(LspivConfig(interval_s=1.0))
    scene = MovingTexture(uniform(0.4), (256, 160), fps=25.0, wave_px=16.0, seed=3)
    (vectors,) = (one for one in map(method.add, scene.frames(26)) if one is not None)
    assert np.abs(vectors.velocity_m_s - [0.4, 0]).max(initial=0) < 0.02


def test_features_that_go_to_the_wrong_wave_are_not_laid_to_a_bed() -> None:
    method = Particles(VelocityConfig(features=150))
    for frame in FAST.frames(11):
        method.add(frame)
    assert method.last is not None
    assert re.search(r"repeats every 1[56] px", method.doubts["repeats"])
    assert "lspiv.max_speed_m_s" in method.doubts["repeats"]
    assert bed_doubt({"dragged": 50}, 50)
    assert not bed_doubt({"dragged": 50}, 50, method.doubts)


def test_features_on_slow_waves_are_not_doubted() -> None:
    method = Particles(VelocityConfig(features=150))
    for frame in MovingTexture(uniform(1.4), (320, 200), fps=10.0, wave_px=16.0, seed=3).frames(11):
        method.add(frame)
    assert method.last is not None
    assert (method.last.kept, method.doubts) == (150, {})
