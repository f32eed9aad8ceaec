"""Spectra, jitter and drift: sines, Parseval's theorem and white noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stab_ros.core.types import FloatArray
from stab_ros.metrics.spectra import jitter_and_drift, spectrum

FPS = 25.0
TIME_S = np.arange(250) / FPS


def sine(amplitude_px: float, frequency_hz: float) -> FloatArray:
    return amplitude_px * np.sin(2 * np.pi * frequency_hz * TIME_S + 0.4)


def test_a_sine_shows_at_its_frequency_with_its_power() -> None:
    found = spectrum(3.0 + sine(0.8, 4.0), FPS)
    assert found.frequency_hz[np.argmax(found.density_px2_hz)] == pytest.approx(4.0)
    near = np.abs(found.frequency_hz - 4.0) < 0.35
    width_hz = found.frequency_hz[1]
    assert found.density_px2_hz[near].sum() * width_hz == pytest.approx(0.8**2 / 2, rel=1e-6)
    assert found.density_px2_hz[~near].sum() * width_hz < 1e-9, "nothing elsewhere, the mean is taken off"


@pytest.mark.parametrize("count", [4, 5, 100, 101])
def test_parseval_holds_for_the_spectrum(count: int) -> None:
    series = np.random.default_rng(count).normal(2, 1, count)
    found = spectrum(series, FPS)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / count)  # Hann
    variance = np.sum((window * (series - series.mean())) ** 2) / np.sum(window**2)
    assert found.density_px2_hz.sum() * FPS / count == pytest.approx(variance)
    assert found.frequency_hz.tolist() == pytest.approx([k * FPS / count for k in range(count // 2 + 1)])


def test_white_noise_has_a_flat_spectrum_of_known_height() -> None:
    found = spectrum(np.random.default_rng(1).normal(0, 0.5, 20000), FPS)
    low, high = found.density_px2_hz[1:5000].mean(), found.density_px2_hz[5000:].mean()
    assert (low, high) == pytest.approx((0.25 / (FPS / 2),) * 2, rel=0.05)


def test_gaps_are_bridged() -> None:
    series = sine(0.8, 0.5)
    series[[0, 40, 41, 42, 249]] = np.nan
    whole, gappy = spectrum(sine(0.8, 0.5), FPS), spectrum(series, FPS)
    np.testing.assert_allclose(gappy.density_px2_hz, whole.density_px2_hz, atol=0.01 * whole.density_px2_hz.max())
    assert spectrum(np.array([1.0, np.nan, 2.0, 3.0, np.nan]), FPS).frequency_hz.size == 0


def test_quick_and_slow_are_told_apart() -> None:
    jitter, drift = jitter_and_drift(sine(0.6, 0.3) + sine(0.2, 7.0), sine(0.1, 5.0), FPS)
    assert jitter == pytest.approx(math.sqrt((0.2**2 + 0.1**2) / 2), rel=0.05)
    assert drift == pytest.approx(0.6 / math.sqrt(2), rel=0.02)
    jitter, drift = jitter_and_drift(sine(0.6, 0.3) + sine(0.2, 7.0), 0 * TIME_S, FPS, split_hz=10.0)
    assert jitter < 0.02
    assert drift == pytest.approx(math.sqrt((0.6**2 + 0.2**2) / 2), rel=0.02)


def test_a_drift_is_not_taken_for_jitter() -> None:
    jitter, drift = jitter_and_drift(4 * TIME_S / TIME_S[-1], np.full(250, -0.5), FPS)
    assert jitter < 0.01
    assert drift == pytest.approx(math.hypot(4 / math.sqrt(3), 0.5), rel=0.01)


@pytest.mark.parametrize("count", [4, 7, 50, 251])
def test_jitter_and_drift_make_up_the_whole(count: int) -> None:
    u, v = np.random.default_rng(count).normal(0.3, 1, (2, count))
    jitter, drift = jitter_and_drift(u, v, FPS)
    assert jitter**2 + drift**2 == pytest.approx(np.mean(u**2 + v**2))
    assert jitter_and_drift(v, u, FPS) == pytest.approx((jitter, drift))


def test_series_too_short_for_frequencies_are_drift() -> None:
    jitter, drift = jitter_and_drift(np.array([3.0, np.nan, -3.0]), np.array([4.0, 7.0, 4.0]), FPS)
    assert (jitter, drift) == (0.0, 5.0)
    assert np.isnan(jitter_and_drift(np.array([np.nan]), np.array([1.0]), FPS)).all()
    assert np.isnan(jitter_and_drift(np.empty(0), np.empty(0), FPS)).all()
    assert spectrum(np.empty(0), FPS).density_px2_hz.size == 0


def test_gaps_in_either_series_are_gaps_of_both() -> None:
    u, v = sine(0.6, 0.3), sine(0.4, 0.2)
    u_gaps, v_gaps = u.copy(), v.copy()
    u_gaps[30:34], v_gaps[100] = np.nan, np.nan
    assert jitter_and_drift(u_gaps, v_gaps, FPS) == pytest.approx(jitter_and_drift(u, v, FPS), abs=0.01)


def test_misuse_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"must be \(T,\)"):
        spectrum(np.zeros((4, 2)), FPS)
    with pytest.raises(ValueError, match="above 0"):
        spectrum(np.zeros(8), 0.0)
    with pytest.raises(ValueError, match="equally long"):
        jitter_and_drift(np.zeros(8), np.zeros(9), FPS)
