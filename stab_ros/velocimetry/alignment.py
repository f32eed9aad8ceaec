"""Iterated alignment of windows with a frame, with what is expected of their deformation, and its covariance.

Few pixels do not tell the deformation of a window (a round tracer does not tell its rotation), so it has a prior: zero,
with standard deviations by what rivers do in the time since the window was cut. The result is the mode of the
posterior, and its covariance includes what an unknown deformation does to the displacement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.velocimetry.posterior import solve
from stab_ros.velocimetry.windows import PARAMETERS, TERMS, Seen, Windows, see

_PASSES = 6
_FLOOR_PX = 0.002  # of deformations that are said to be known


@dataclass(frozen=True, eq=False)
class Pose:
    """Where n windows are assumed in a frame.

    Attributes:
        at_px: (n, 2), of their centres.
        carried: (n, 2, 2), derivative of pixels of the frame by those of the window, for what is at rest on the plane.
        bent_px: (n, 2, 6), what the flow has displaced of the window since it was cut: coefficients as of `Windows`,
            those of the constant 0.
    """

    at_px: FloatArray
    carried: FloatArray
    bent_px: FloatArray

    def __getitem__(self, which: IdArray | BoolArray) -> Pose:
        return Pose(self.at_px[which], self.carried[which], self.bent_px[which])

    def places_px(self, radius: int) -> FloatArray:
        """(n, 2, 6), coefficients of the places of the points of the windows in the frame."""
        unbent = self.bent_px.copy()
        unbent[:, :, 1:3] += radius * np.eye(2)
        places = self.carried @ unbent
        places[:, :, 0] = self.at_px
        return np.asarray(places)

    def moved(self, change_px: FloatArray, radius: int) -> Pose:
        """The poses after a displacement (n, 2, 6) that is found in the windows."""
        grown = np.eye(2) + self.bent_px[:, :, 1:3] / radius
        at_px = self.at_px + np.einsum("nij,njk,nk->ni", self.carried, grown, change_px[:, :, 0])
        bent_px = self.bent_px + grown @ change_px
        bent_px[:, :, 0] = 0
        return Pose(at_px, self.carried, bent_px)


@dataclass(frozen=True, eq=False)
class Aligned:
    """Where n windows were found.

    Attributes:
        pose: of each.
        covariance_px2: (n, 2, 2), of `pose.at_px`.
        correlation: (n,) with the template; 0 where it was not compared.
    """

    pose: Pose
    covariance_px2: FloatArray
    correlation: FloatArray


def align(windows: Windows, chosen: IdArray, gray: Gray, assumed: Pose, sigma_px: FloatArray,
          within_px: float) -> Aligned:
    """Finds windows near where they are assumed.

    Args:
        windows: of an earlier frame.
        chosen: (n,) which of them.
        gray: (h, w) uint8.
        assumed: of the chosen ones.
        sigma_px: (n, 6), standard deviations of the coefficients of `bent_px` before anything is seen; that of the
            constant is not used: it is free.
        within_px: a window whose points move no more than this in a pass is done.
    """
    n = len(chosen)
    pose, covariance, correlation = assumed[np.arange(n)], np.zeros((n, 2, 2)), np.zeros(n)
    moving = np.arange(n)
    for _ in range(_PASSES):
        before = pose[moving]
        seen = see(windows, chosen[moving], gray, before.places_px(windows.radius))
        change, spread = _solved(windows, chosen[moving], seen, before.bent_px, sigma_px[moving])
        after = before.moved(change, windows.radius)
        pose.at_px[moving], pose.bent_px[moving] = after.at_px, after.bent_px
        grown = before.carried @ (np.eye(2) + before.bent_px[:, :, 1:3] / windows.radius)
        covariance[moving] = grown @ spread @ grown.transpose(0, 2, 1)
        correlation[moving] = seen.correlation
        moving = moving[(np.abs(change).max(axis=(1, 2), initial=0) > within_px) & (seen.gain > 0)]
        if not len(moving):
            break
    return Aligned(pose, covariance, correlation)


def _solved(windows: Windows, chosen: IdArray, seen: Seen, bent_px: FloatArray,
            sigma_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Changes (n, 2, 6) of the coefficients, px, and covariance (n, 2, 2) of the displacement of the centre."""
    change, spread = np.zeros((len(chosen), 2, TERMS)), np.zeros((len(chosen), 2, 2))
    variance = np.tile(np.maximum(sigma_px, _FLOOR_PX) ** 2, 2)
    solve(chosen, windows.response, windows.gram, seen.products, seen.noise,
           bent_px.reshape(-1, PARAMETERS), variance, change.reshape(-1, PARAMETERS), spread)
    return change, spread
