"""Residual motion by frequency: slow drift and fast jitter.

A series has one displacement per frame, px, evenly spaced in time; NaN where a frame was not measured. Gaps are
interpolated linearly, which slightly reduces the jitter; the ends are extended by the first and last value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray

SPLIT_HZ = 1.0  # between drift and jitter
_MIN_VALUES = 4  # for a spectrum


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided power spectral density: frequency_hz (M,) and density_px2_hz (M,), px^2/Hz; empty without data."""

    frequency_hz: FloatArray
    density_px2_hz: FloatArray


def spectrum(shift_px: FloatArray, fps: float) -> Spectrum:
    """Periodogram of a series with a Hann window, mean removed; empty for fewer than 4 values.

    Its sum times the frequency spacing is the window-weighted variance (Parseval).

    Args:
        shift_px: (T,).
        fps: frames per second.

    Raises:
        ValueError: a series that is not (T,), or `fps` not above 0.
    """
    series = _checked(shift_px, fps)
    if np.isfinite(series).sum() < _MIN_VALUES:
        return Spectrum(np.empty(0), np.empty(0))
    series = _interpolated(series)
    window = np.sin(np.pi * np.arange(len(series)) / len(series)) ** 2
    power = np.abs(np.fft.rfft(window * (series - series.mean()))) ** 2
    density = power * _multiplicity(len(series)) / (fps * (window**2).sum())
    return Spectrum(np.fft.rfftfreq(len(series), 1 / fps), density)


def jitter_and_drift(u_px: FloatArray, v_px: FloatArray, fps: float, split_hz: float = SPLIT_HZ) -> tuple[float, float]:
    """RMS length of the displacement, px, above `split_hz` (jitter) and at or below it, with the mean (drift).

    jitter^2 + drift^2 = mean(u^2 + v^2). The series are mirrored at their ends, so that a drift does not appear as
    jitter. With fewer than 4 values everything is drift; without values both are NaN.

    Args:
        u_px: (T,) displacement along x.
        v_px: (T,) displacement along y.
        fps: frames per second.
        split_hz: frequency that separates drift and jitter.

    Raises:
        ValueError: series that are not (T,) of equal length, or `fps` not above 0.
    """
    pair = [_checked(series, fps) for series in (u_px, v_px)]
    if len(pair[0]) != len(pair[1]):
        raise ValueError(f"series of {len(pair[0])} and {len(pair[1])} frames, they must be equally long")
    known = np.isfinite(pair[0]) & np.isfinite(pair[1])
    if not known.any():
        return np.nan, np.nan
    if known.sum() < _MIN_VALUES:
        return 0.0, float(np.sqrt(np.mean(pair[0][known] ** 2 + pair[1][known] ** 2)))
    path = np.stack([_interpolated(np.where(known, series, np.nan)) for series in pair])
    power = _mirrored_power(path)
    quick = np.fft.rfftfreq(2 * path.shape[1], 1 / fps) > split_hz
    return float(np.sqrt(power[:, quick].sum())), float(np.sqrt(power[:, ~quick].sum()))


def _mirrored_power(path: FloatArray) -> FloatArray:
    """Mean square (2, M) of the series (2, T) by frequency, each extended by its mirror image."""
    mirrored = np.concatenate([path, path[:, ::-1]], axis=1)
    count = mirrored.shape[1]
    return np.asarray(np.abs(np.fft.rfft(mirrored) / count) ** 2 * _multiplicity(count))


def _multiplicity(count: int) -> FloatArray:
    """Multiplicity (count // 2 + 1,) of each frequency of a half spectrum in the full one."""
    times = np.full(count // 2 + 1, 2.0)
    times[0] = 1.0
    if count % 2 == 0:
        times[-1] = 1.0
    return times


def _checked(series: FloatArray, fps: float) -> FloatArray:
    values = np.asarray(series, np.float64)
    if values.ndim != 1 or not fps > 0:
        raise ValueError(f"a series of {values.shape} at {fps} frames/s, it must be (T,) and above 0")
    return values


def _interpolated(series: FloatArray) -> FloatArray:
    known = np.flatnonzero(np.isfinite(series))
    return np.asarray(np.interp(np.arange(len(series)), known, series[known]))
