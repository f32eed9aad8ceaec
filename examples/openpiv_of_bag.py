"""Surface velocities by OpenPIV, from the stabilised images of a bag that `stab-ros stabilize` or the recorder wrote.

    python3 -m venv piv && piv/bin/pip install openpiv 'rosbags>=0.11'
    piv/bin/python openpiv_of_bag.py stabilised.mcap V_openpiv.csv --gsd 0.06 --gap 8

It needs neither ROS nor stab_ros. OpenPIV is under the GPL-3: whoever wants it installs it for himself.

Pairs of frames, `--gap` frames apart, go through OpenPIV's multi-pass with its validation of each pass. A row of the
CSV is the median over the pairs at one place: x_px, y_px of the reference, vx_m_s to the right, vy_m_s down. Where the
bag has `static_map`, windows on ground are left out, and so are those that some frame does not show.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

_SIDES_PX = (64, 32, 16)  # of the windows of each pass
_USABLE = 0.9  # of a window that must be water, and seen by every frame
_LUMINANCE = {"bgr8": (0.114, 0.587, 0.299), "rgb8": (0.299, 0.587, 0.114)}
Array = NDArray[Any]


def images(bag: Path, topic: str) -> Iterator[tuple[float, Array]]:
    """Time in s and grey image (h, w) of each message of the topics whose names end so."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        found = [one for one in reader.connections if one.topic.endswith(topic)]
        for connection, _, data in reader.messages(found) if found else ():
            message: Any = reader.deserialize(data, connection.msgtype)
            yield message.header.stamp.sec + message.header.stamp.nanosec * 1e-9, grey(message)


def grey(message: Any) -> Array:
    """(h, w) uint8, of mono8, bgr8 or rgb8."""
    weights = _LUMINANCE.get(message.encoding, (1.0,))
    rows = np.reshape(message.data, (message.height, message.step))[:, : message.width * len(weights)]
    return np.asarray(np.round(rows.reshape(message.height, message.width, -1) @ weights), np.uint8)


def shift_px(before: Array, after: Array) -> tuple[Array, Array]:
    """Displacements (rows, columns) to the right and down, px; NaN where OpenPIV's validation flags them."""
    settings: Any = importlib.import_module("openpiv.settings").PIVSettings(
        windowsizes=_SIDES_PX, overlap=tuple(side // 2 for side in _SIDES_PX), num_iterations=len(_SIDES_PX))
    windef: Any = importlib.import_module("openpiv.windef")
    _, _, right, up, flags = windef.simple_multipass(before.astype(np.int32), after.astype(np.int32), settings)
    flagged = np.asarray(flags, bool)
    return np.where(flagged, np.nan, right), np.where(flagged, np.nan, -up)


def places_px(size: tuple[int, ...]) -> tuple[Array, Array]:
    """Middles (rows, columns) of the windows of the last pass."""
    pyprocess: Any = importlib.import_module("openpiv.pyprocess")
    x_px, y_px = pyprocess.get_rect_coordinates(size, _SIDES_PX[-1], _SIDES_PX[-1] // 2)
    return x_px, y_px


def is_usable(usable: Array, x_px: Array, y_px: Array) -> Array:
    """Whether enough of the window at each place is usable, (rows, columns)."""
    half = _SIDES_PX[-1] // 2
    windows = [usable[max(y - half, 0) : y + half, max(x - half, 0) : x + half].mean()
               for x, y in zip(x_px.astype(int).ravel(), y_px.astype(int).ravel(), strict=True)]
    return np.reshape(windows, x_px.shape) >= _USABLE


def velocities(bag: Path, gsd_m: float, gap: int) -> Array:
    """Rows x_px, y_px, vx_m_s, vy_m_s."""
    stamps_s, frames = zip(*images(bag, "/image_stabilized"), strict=True)
    pairs = []
    for i in range(0, len(frames) - gap, gap):
        scale = gsd_m / (stamps_s[i + gap] - stamps_s[i])
        pairs.append(np.array(shift_px(frames[i], frames[i + gap])) * scale)
    x_px, y_px = places_px(frames[0].shape)
    usable = np.min(frames, axis=0) > 0  # beyond the border of a frame it is black
    for _, ground in images(bag, "/static_map"):
        usable &= ground == 0
    kept = is_usable(usable, x_px, y_px) & np.isfinite(pairs).all(axis=1).any(axis=0)
    vx_m_s, vy_m_s = np.nanmedian(np.array(pairs)[:, :, kept], axis=0)
    return np.column_stack([x_px[kept], y_px[kept], vx_m_s, vy_m_s])


def main() -> None:
    """Does the work."""
    parser = argparse.ArgumentParser(description="Surface velocities by OpenPIV, from a bag of stabilised images.")
    parser.add_argument("bag", type=Path)
    parser.add_argument("table", type=Path)
    parser.add_argument("--gsd", type=float, required=True, help="ground sampling distance, m a pixel")
    parser.add_argument("--gap", type=int, default=8, help="frames from one image of a pair to the other")
    given = parser.parse_args()
    if importlib.util.find_spec("openpiv") is None:
        sys.exit("OpenPIV is not installed here: pip install openpiv")
    rows = velocities(given.bag, given.gsd, given.gap)
    np.savetxt(given.table, rows, fmt="%.6g", delimiter=",", header="x_px,y_px,vx_m_s,vy_m_s", comments="")
    print(f"{len(rows)} vectors, median speed {np.median(np.hypot(rows[:, 2], rows[:, 3])):.3f} m/s")


if __name__ == "__main__":
    main()
