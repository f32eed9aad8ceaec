"""The error of a frame that is placed by followed control points: what its tracking adds, and what all frames share.

Marks and survey of the points are the same in all frames, and so are their errors e, whitened. The fit to the first
frame makes of them errors x0 = G0 e of its parameters, that to another frame x = G e: G is its gain. Shared is what x0
tells of x, which is G G0^T (G0 G0^T)^-1 x0, by least squares. The frame's own is what x0 does not tell, as where other
points are seen, and what tracking adds to the places of the points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.georeferencing.camera_fit import CameraFit
from stab_ros.georeferencing.place_error import PlaceError


def followed_error(first: CameraFit, fit: CameraFit, seen: BoolArray, tracking_px2: FloatArray,
                   wse_m: float) -> PlaceError:
    """The error of the place on the water, but that of its level.

    Args:
        first: the fit to the N points of the frame in which they were marked.
        fit: that of the pose to those of them that are seen in another frame.
        seen: (N,) bool, n of them.
        tracking_px2: (n, 2, 2), covariance of where each of those was found, relative to its mark.
        wse_m: water surface elevation.
    """
    joint = replace(fit, solution=replace(fit.solution, problem=replace(
        fit.solution.problem, unknowns=first.unknowns)))  # a focal length that was fitted is as wrong as it was
    J, G0, G = joint.by_parameters(wse_m), first.solution.gain, _gain(first, joint, fit, seen)
    told = G @ G0.T @ np.linalg.pinv(G0 @ G0.T)
    untold = G - told @ G0
    own = _tracked(fit, tracking_px2, len(G)) + first.solution.covering_variance * untold @ untold.T
    return PlaceError(J @ own @ J.T, J @ told @ factor(first.solution.covariance))


def _gain(first: CameraFit, joint: CameraFit, fit: CameraFit, seen: BoolArray) -> FloatArray:
    """(n0, 2 N), what errors e of all points do to the parameters of the first fit in another frame."""
    columns = np.repeat(seen, 2)
    pose = np.zeros((len(fit.solution.gain), len(columns)))
    pose[:, columns] = fit.solution.gain
    focal = first.solution.gain[first.unknowns.focal]
    by_focal = joint.solution.jacobian[:, :, first.unknowns.focal].reshape(columns.sum(), -1)
    return np.concatenate([pose - pose[:, columns] @ by_focal @ focal, focal])


def _tracked(fit: CameraFit, tracking_px2: FloatArray, parameters: int) -> FloatArray:
    """(n0, n0) covariance of the parameters by tracking, which leaves the focal length alone."""
    gain = fit.solution.gain
    by_pixels = np.einsum("pni,nij->pnj", gain.reshape(len(gain), -1, 2), fit.solution.whitening)
    found = np.zeros((parameters, parameters))
    found[: len(gain), : len(gain)] = np.einsum("pni,nij,qnj->pq", by_pixels, tracking_px2, by_pixels)
    return found
