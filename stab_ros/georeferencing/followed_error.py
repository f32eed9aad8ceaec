"""The error of a frame that is placed by followed control points: what its tracking adds, and what all frames share.

Marks and survey of the points are the same in all frames, and so are their errors e, whitened. The fit to the first
frame makes of them errors x0 = G0 e of its parameters, that to another frame x = G e: G is its gain. Shared is what x0
tells of x, which is G G0^T (G0 G0^T)^-1 x0, by least squares. The frame's own is what x0 does not tell, as where other
points are seen, and what tracking adds to the places of the points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.georeferencing.camera_fit import CameraFit
from stab_ros.georeferencing.place_error import PlaceError
from stab_ros.georeferencing.pose_link import PoseLink


@dataclass(frozen=True, eq=False)
class FollowedError:
    """The error of a frame by its parameters: pose, then the focal lengths of the first fit.

    Attributes:
        joint: the fit, with those parameters.
        own: (n, n) covariance of what the frame has by itself.
        shared: (n, n), changes by one standard deviation of each of n errors that all frames share.
    """

    joint: CameraFit
    own: FloatArray
    shared: FloatArray

    @staticmethod
    def of_marked(first: CameraFit) -> FollowedError:
        """That of the frame in which the points were marked: all of it is shared."""
        spread = factor(first.solution.covariance)
        return FollowedError(first, np.zeros_like(spread), spread)

    @property
    def pose_covariance(self) -> FloatArray:
        """(6, 6), as of `Placement`."""
        return np.asarray(self.own[:6, :6] + self.shared[:6] @ self.shared[:6].T)

    @property
    def pose_link(self) -> PoseLink:
        """Frames share the errors of marks and survey."""
        return PoseLink("followed control points", {"control points": self.shared[:6]})

    def on_water(self, wse_m: float) -> PlaceError:
        """The error of the place on the water, but that of its level. wse_m: water surface elevation."""
        J = self.joint.by_parameters(wse_m)
        return PlaceError(J @ self.own @ J.T, J @ self.shared)


def followed_error(first: CameraFit, fit: CameraFit, seen: BoolArray, tracking_px2: FloatArray) -> FollowedError:
    """The error of a frame.

    Args:
        first: the fit to the N points of the frame in which they were marked.
        fit: that of the pose to those of them that are seen in another frame.
        seen: (N,) bool, n of them.
        tracking_px2: (n, 2, 2), covariance of where each of those was found, relative to its mark.
    """
    joint = replace(fit, solution=replace(fit.solution, problem=replace(
        fit.solution.problem, unknowns=first.unknowns)))  # a focal length that was fitted is as wrong as it was
    G0, G = first.solution.gain, _gain(first, joint, fit, seen)
    told = G @ G0.T @ np.linalg.pinv(G0 @ G0.T)
    untold = G - told @ G0
    own = _tracked(fit, tracking_px2, len(G)) + first.solution.covering_variance * untold @ untold.T
    return FollowedError(joint, own, told @ factor(first.solution.covariance))


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
