"""The graf pictures (Mikolajczyk and Schmid 2005): a wall from other sides, with measured homographies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from effort import Effort
from tables import Table, number, verdict

from stab_ros.core.geometry import apply
from stab_ros.core.settings import Value
from stab_ros.core.types import Frame, Gray, Homography
from stab_ros.parameters.engines import make_stabilizer

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data" / "graf"
TARGETS_PX = {2: 3.0, 3: 6.0}  # by picture
METHODS = ("sift", "akaze")
# It is no river seen from a drone: not all of the wall is flat, and little of what img1 shows is found again in img3.
SETTINGS: Mapping[str, Mapping[str, Value]] = {
    "": {},
    ", wide gates": {"estimator": "ransac", "threshold": 3.0, "min_inlier_share": 0.02, "max_sigma": 3.0},
}
_NOTE = ("Mean distance between where the inverse of ref_H_cur and the measured homography put the corners of img1; "
         "none where the picture is lost. Wide gates: ransac, threshold 3 px, min_inlier_share 0.02, max_sigma 3.")


def measure(_effort: Effort) -> tuple[Table, Mapping[str, object]]:
    """Says so where the pictures are not there."""
    title = "graf: other sides of a wall"
    if not FOLDER.is_dir():
        return Table(title, ("left out: no such folder",), [(str(FOLDER),)]), {}
    errors = {method + name: {k: _corner_error_px({"method": method, **values}, k) for k in TARGETS_PX}
              for method in METHODS for name, values in SETTINGS.items()}
    head = ("corner error, px", *(cell for k in TARGETS_PX for cell in (f"H1to{k}p", "target", "met")))
    rows = [(name, *(cell for k, error in found.items()
                     for cell in (number(error, 2), *verdict(error, TARGETS_PX[k]))))
            for name, found in errors.items()]
    data = {name: {f"H1to{k}p": None if np.isnan(error) else error for k, error in found.items()}
            for name, found in errors.items()}
    return Table(title, head, rows, _NOTE), data


def _corner_error_px(values: Mapping[str, Value], picture: int) -> float:
    """NaN where the picture is lost."""
    stabilizer = make_stabilizer(values)
    first, other = _gray(1), _gray(picture)
    stabilizer.track(Frame(first, "mono8", 0))
    found = stabilizer.track(Frame(other, "mono8", 1)).ref_H_cur
    return float("nan") if found is None else _mean_px(np.linalg.inv(found), _measured(picture), first)


def _mean_px(one: Homography, other: Homography, first: Gray) -> float:
    height, width = first.shape
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1.0]])
    return float(np.linalg.norm(apply(one, corners) - apply(other, corners), axis=1).mean())


def _gray(picture: int) -> Gray:
    return np.asarray(cv2.imread(str(FOLDER / f"img{picture}.png"), cv2.IMREAD_GRAYSCALE), np.uint8)


def _measured(picture: int) -> Homography:
    """From img1 to the picture."""
    return np.loadtxt(FOLDER / f"H1to{picture}p")
