"""A process that measures with pyorc (AGPL-3), engine FFPIV; runs in pyorc's own environment. See peers_child.py.

The frames count as projected already, so nothing is resampled. settings: {"window": side, px, "gap": every which frame
is taken, "normalize": whether the mean over time is taken off, "edges": whether edges are enhanced, "ensemble": whether
correlations are averaged, "slowest_m_s": of the mask of speeds}
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
from peers_child import serve

xr: Any = importlib.import_module("xarray")
cv2: Any = importlib.import_module("cv2")
importlib.import_module("pyorc")  # gives xarray its accessors
get_ffpiv: Any = importlib.import_module("pyorc.velocimetry.ffpiv").get_ffpiv
to_even: Any = importlib.import_module("ffpiv.window").round_to_even
coordinates: Any = importlib.import_module("ffpiv.window").get_rect_coordinates

_MASKS: tuple[tuple[str, dict[str, Any]], ...] = (  # those of its example ngwerere, in that order
    ("corr", {}), ("minmax", {}), ("rolling", {}), ("outliers", {}), ("variance", {}), ("count", {}),
    ("window_mean", {"wdw": 2, "tolerance": 0.5, "reduce_time": True}))


def measure(frames: Any, question: Mapping[str, Any]) -> Any:
    """(N, 5) as peers_child.py; the median over time of what the masks leave."""
    settings, gsd_m = question["settings"], question["gsd_m"]
    pictures = _projected(frames, settings["gap"], question["fps"], gsd_m)
    if settings["normalize"]:
        pictures = pictures.frames.normalize(samples=min(15, len(pictures)))
    if settings["edges"]:
        pictures = pictures.frames.edge_detect(wdw_1=1, wdw_2=2).frames.minmax(min=-5, max=5)
    window, overlap = to_even(2 * (settings["window"],)), 2 * (round(settings["window"] / 2),)  # as its get_piv
    columns, rows = coordinates(dim_size=frames[0].shape, window_size=window, overlap=overlap)
    piv = get_ffpiv(pictures, pictures.y.values[rows], pictures.x.values[columns], pictures["time"].diff(dim="time"),
                    window_size=window, overlap=overlap, search_area_size=window, res_y=gsd_m, res_x=gsd_m,
                    engine="numba", ensemble_corr=settings["ensemble"])
    piv.attrs["camera_config"] = ""  # masks ask for it, and do not look into it
    _mask(piv, settings["slowest_m_s"])
    middle = piv.median(dim="time")
    x, y = np.meshgrid(columns, rows)
    east, south = (middle[name].values.ravel() for name in ("v_x", "v_y"))  # its v_y points down the picture
    table = np.column_stack([x.ravel(), y.ravel(), east, -south, np.zeros(x.size)])
    return table[np.isfinite(table).all(axis=1)]


def _projected(frames: Any, gap: int, fps: float, gsd_m: float) -> Any:
    """As pyorc has them: time in s, x to the right and y up, m."""
    taken, (height, width) = frames[::gap], frames[0].shape
    return xr.DataArray(taken, dims=("time", "y", "x"), coords={
        "time": np.arange(len(taken)) * gap / fps, "y": gsd_m * (height - 0.5 - np.arange(height)),
        "x": gsd_m * (0.5 + np.arange(width))})


def _mask(piv: Any, slowest_m_s: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # masks over time do nothing to an ensemble
        for name, values in _MASKS:
            given = {"s_min": slowest_m_s} if name == "minmax" else values
            getattr(piv.velocimetry.mask, name)(inplace=True, **given)


def _read(path: str) -> Any:
    return cv2.imread(path, cv2.IMREAD_GRAYSCALE)


if __name__ == "__main__":
    serve(f"pyorc {version('pyopenrivercam')}", _read, measure)
