"""Surface velocities by pyorc, from the stabilised video that `stab-ros stabilize --video` writes.

    python3 -m venv orc && orc/bin/pip install pyopenrivercam
    orc/bin/python pyorc_of_video.py stabilised.mp4 V_pyorc.csv --gsd 0.06 --every 8

It needs neither ROS nor stab_ros. pyorc is under the AGPL-3: whoever wants it installs it for himself.

The reference counts as a nadir view: its corners become pyorc's four control points, at the given ground sampling
distance. pyorc then projects, correlates and masks as it does for any camera; its own stabilisation stays off. A row of
the CSV is the median over time at one place: x_px, y_px of the reference, vx_m_s to the right, vy_m_s down.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_WINDOW_PX = 32
Array = NDArray[Any]


def nadir_camera(size: tuple[int, int], gsd_m: float) -> Any:
    """The camera of pyorc for a view straight down: width and height in px, metres a pixel."""
    pyorc: Any = importlib.import_module("pyorc")
    width, height = size
    corners_px = [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]]
    corners_m = [[x * gsd_m, (height - 1 - y) * gsd_m] for x, y in corners_px]
    camera = pyorc.CameraConfig(height=height, width=width, resolution=gsd_m, window_size=_WINDOW_PX,
                                gcps={"src": corners_px, "dst": corners_m, "z_0": 0.0, "h_ref": 0.0}, is_nadir=True)
    camera.set_bbox_from_corners(corners_px)
    return camera


def velocities(video: Path, gsd_m: float, every: int) -> Array:
    """Rows x_px, y_px, vx_m_s, vy_m_s."""
    pyorc: Any = importlib.import_module("pyorc")
    cv2: Any = importlib.import_module("cv2")
    opened = cv2.VideoCapture(str(video))
    size = int(opened.get(cv2.CAP_PROP_FRAME_WIDTH)), int(opened.get(cv2.CAP_PROP_FRAME_HEIGHT))
    reader = pyorc.Video(str(video), camera_config=nadir_camera(size, gsd_m), h_a=0.0, freq=every)
    projected = reader.get_frames().frames.project()
    piv = projected.frames.get_piv()
    for mask in ("corr", "minmax", "outliers"):
        getattr(piv.velocimetry.mask, mask)(inplace=True)
    middle = piv.median(dim="time")
    x_m, y_m = np.meshgrid(middle["x"].values, middle["y"].values)
    rows = np.column_stack([(x_m / gsd_m).ravel(), (size[1] - 1 - y_m / gsd_m).ravel(),
                            middle["v_x"].values.ravel(), middle["v_y"].values.ravel()])  # v_y points down the picture
    return np.asarray(rows[np.isfinite(rows).all(axis=1)])


def main() -> None:
    """Does the work."""
    parser = argparse.ArgumentParser(description="Surface velocities by pyorc, from a stabilised video.")
    parser.add_argument("video", type=Path)
    parser.add_argument("table", type=Path)
    parser.add_argument("--gsd", type=float, required=True, help="ground sampling distance, m a pixel")
    parser.add_argument("--every", type=int, default=8, help="which frames are taken: each n-th")
    given = parser.parse_args()
    if importlib.util.find_spec("pyorc") is None:
        sys.exit("pyorc is not installed here: pip install pyopenrivercam")
    rows = velocities(given.video, given.gsd, given.every)
    np.savetxt(given.table, rows, fmt="%.6g", delimiter=",", header="x_px,y_px,vx_m_s,vy_m_s", comments="")
    print(f"{len(rows)} vectors, median speed {np.median(np.hypot(rows[:, 2], rows[:, 3])):.3f} m/s")


if __name__ == "__main__":
    main()
