"""Residual motion by frequency: slow drift or quick jitter?

A series is one shift per frame, px, evenly spaced in time; NaN where a frame could not be measured. Gaps are bridged by
straight lines, which takes a little of the jitter out; before the first and after the last value, that value holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray

SPLIT_HZ = 1.0  # between drift and jitter
_FEWEST = 4  # values, for anything to be said about frequencies


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided power spectral density. frequency_hz: (M,). density_px2_hz: (M,), px^2/Hz; both empty without data."""

    frequency_hz: FloatArray
    density_px2_hz: FloatArray


def spectrum(shift_px: FloatArray, fps: float) -> Spectrum:
    """Periodogram of a series, (T,), about its mean, under a Hann window; empty for fewer than 4 values.

    Its sum times the spacing of the frequencies is the variance, as the window weighs it (Parseval).

    Raises:
        ValueError: a series that is not (T,), or `fps` that is not above 0.
    """
    series = _checked(shift_px, fps)
    if np.isfinite(series).sum() < _FEWEST:
        return Spectrum(np.empty(0), np.empty(0))
    series = _bridged(series)
    window = np.sin(np.pi * np.arange(len(series)) / len(series)) ** 2
    power = np.abs(np.fft.rfft(window * (series - series.mean()))) ** 2
    density = power * _occurrences(len(series)) / (fps * (window**2).sum())
    return Spectrum(np.fft.rfftfreq(len(series), 1 / fps), density)


def jitter_and_drift(u_px: FloatArray, v_px: FloatArray, fps: float, split_hz: float = SPLIT_HZ) -> tuple[float, float]:
    """RMS length of the shifts, px, in what is quicker than `split_hz`, and in the rest with the mean.

    jitter^2 + drift^2 = mean(u^2 + v^2). The series are mirrored at their ends, so that a drift, whose end does not
    fit its beginning, is not taken for jitter. With fewer than 4 values all is drift; without any, both are NaN.

    Raises:
        ValueError: series that are not (T,) and of one length, or `fps` that is not above 0.
    """
    pair = [_checked(series, fps) for series in (u_px, v_px)]
    if len(pair[0]) != len(pair[1]):
        raise ValueError(f"series of {len(pair[0])} and {len(pair[1])} frames, they must be equally long")
    known = np.isfinite(pair[0]) & np.isfinite(pair[1])
    if not known.any():
        return np.nan, np.nan
    if known.sum() < _FEWEST:
        return 0.0, float(np.sqrt(np.mean(pair[0][known] ** 2 + pair[1][known] ** 2)))
    path = np.stack([_bridged(np.where(known, series, np.nan)) for series in pair])
    power = _mirrored_power(path)
    quick = np.fft.rfftfreq(2 * path.shape[1], 1 / fps) > split_hz
    return float(np.sqrt(power[:, quick].sum())), float(np.sqrt(power[:, ~quick].sum()))


def _mirrored_power(path: FloatArray) -> FloatArray:
    """(2, M): the mean square of the series, (2, T), by frequency, each continued by its mirror image."""
    mirrored = np.concatenate([path, path[:, ::-1]], axis=1)
    count = mirrored.shape[1]
    return np.asarray(np.abs(np.fft.rfft(mirrored) / count) ** 2 * _occurrences(count))


def _occurrences(count: int) -> FloatArray:
    """(count // 2 + 1,): how often each frequency of a half spectrum occurs in the whole one."""
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


def _bridged(series: FloatArray) -> FloatArray:
    known = np.flatnonzero(np.isfinite(series))
    return np.asarray(np.interp(np.arange(len(series)), known, series[known]))
