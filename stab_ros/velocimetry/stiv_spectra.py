"""The rows of a space-time image as spectra, which are sheared upright without a loss."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from stab_ros.core.types import FloatArray, IdArray

END_PX = 12  # of the line on each side, which the band-pass blurs
_LOW_PASS_PX, _HIGH_PASS_PX = 1.0, 5.0  # standard deviations of Gaussians
_TURNS = 8  # of the estimate of what stands; more of them change nothing but the longest waves


@dataclass(frozen=True, eq=False)
class Spectra:
    """Rows of a space-time image as spectra, band-passed, on twice their length so that shears do not wrap around.

    Attributes:
        rows: (T, K).
        k: (K,) wave numbers, 1/px.
        time_s: (T,) of the rows, 0 in the mean.
        length_px: of the line.
        width: number of samples of which the spectra are, even.
    """

    rows: NDArray[np.complex128]
    k: FloatArray
    time_s: FloatArray
    length_px: int
    width: int

    @staticmethod
    def of(image: FloatArray, time_s: FloatArray) -> Spectra:
        """Those of a space-time image (T, L), whose rows are at time_s (T,)."""
        width = 2 * next_fast_len(image.shape[1], real=True)
        k = 2 * np.pi * np.fft.rfftfreq(width)
        band = (1 - np.exp(-(k * _HIGH_PASS_PX) ** 2 / 2)) * np.exp(-(k * _LOW_PASS_PX) ** 2 / 2)
        return Spectra(np.fft.rfft(image, width, axis=1) * band, k, time_s - time_s.mean(), image.shape[1], width)

    def upright(self, velocity: float) -> NDArray[np.complex128]:
        """The spectra (T, K) with what moves at `velocity` upright."""
        return np.asarray(self.rows * self._turn(velocity))

    def sheared(self, velocity: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The image with what moves at `velocity` upright, its derivative along the line, and 1 where it is seen.

        Each (T, width). The ends of the line, which stand still, are not counted as seen.
        """
        turned = self.upright(velocity)
        return (self._image(turned), self._image(1j * self.k * turned), self._seen(velocity))

    def pairs(self, lag: int) -> IdArray:
        """(P, 2) rows `lag` apart, without those between which frames are missing."""
        first = np.arange(len(self.time_s) - lag)
        dt = self.time_s[first + lag] - self.time_s[first]
        first = first[np.abs(dt - np.median(dt)) < 0.5 * np.median(dt) / lag]
        return np.stack([first, first + lag], axis=1)

    def without_standing(self, velocity: float) -> Spectra:
        """Less what stands still as it is beside a pattern that drifts at `velocity`, in place of the rows' mean.

        Least squares of `rows(t) = standing + drifting(x - velocity t)`, one after the other by turns (backfitting:
        Buja, Hastie and Tibshirani 1989), from rows without their mean on. So rows get back what of the drifting
        pattern has gone with their mean, but for waves longer than its way and for the ends of the line.
        """
        turn, seen = self._turn(velocity), self._seen(velocity)
        drawn_out, count = np.conj(turn).mean(axis=0), np.maximum(seen.sum(axis=0), 1)
        line = np.arange(self.width) < self.length_px
        mean, standing = self.rows.mean(axis=0), np.zeros(len(self.k), np.complex128)
        for _ in range(_TURNS):
            drifting = (self._image((self.rows - standing) * turn) * seen).sum(axis=0) / count
            left = self._image(mean - drawn_out * np.fft.rfft(drifting)) * line
            standing = np.asarray(np.fft.rfft(left), np.complex128)
        return replace(self, rows=self.rows - standing)

    def _turn(self, velocity: float) -> NDArray[np.complex128]:
        return np.asarray(np.exp(1j * self.k * velocity * self.time_s[:, None]))

    def _image(self, spectra: NDArray[np.complex128]) -> FloatArray:
        return np.asarray(np.fft.irfft(spectra, self.width, axis=-1))

    def _seen(self, velocity: float) -> FloatArray:
        """(T, width), of the upright image: 1 where the line is, without its ends."""
        place_px = (np.arange(self.width) + velocity * self.time_s[:, None]) % self.width
        return np.asarray((place_px >= END_PX) & (place_px <= self.length_px - 1 - END_PX), float)
