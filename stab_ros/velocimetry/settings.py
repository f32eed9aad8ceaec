"""The settings of velocimetry: how features of the water are found, followed and judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, Value, setting

METHODS: Mapping[str, str] = MappingProxyType({  # method: the parameter that tells how long an interval is
    "particles": "extract_s", "lspiv": "lspiv.interval_s", "stiv": "stiv.interval_s"})
FOLLOW = ("template", "klt")
SELECTION = ("even", "strongest")


@dataclass(frozen=True)
class VelocityConfig(Checked):
    """How velocities are measured; each field carries its range and meaning.

    Lengths and speeds are in metres where frames are georeferenced, and in pixels of the reference where they are not.

    Raises:
        ConfigError: a value has the wrong type or is out of range, or values contradict each other.
    """

    method: str = setting(
        "particles", "How velocities are measured: particles (features followed from frame to frame), lspiv (cross-"
        "correlation on a grid), stiv (space-time images along lines)", choices=tuple(METHODS))
    extract_s: float = setting(
        1.0, "Length of an interval in seconds: a vector leads from the first to the last position of a feature in it; "
        "then features are detected anew", 0.04, 10.0)
    max_gap_s: float = setting(
        0.5, "Largest gap between frames in seconds; after a longer one an interval ends with the frame before it",
        0.01, 60.0)
    features: int = setting(600, "Largest number of features in an interval: it bounds the time per frame", 1, 100000)
    selection: str = setting(
        "even", "Which corners are followed: even (the best of each cell of a grid on the water) or strongest (those "
        "with the largest minimum eigenvalue)", choices=SELECTION)
    min_quality: float = setting(
        0.01, "Minimum eigenvalue of a corner, as a share of the largest where features may begin", 0.0, 1.0)
    ignore_edges: float = setting(
        0.1, "Share of width and height at each border of the image in which no feature is detected", 0.0, 0.45)
    block_px: int = setting(31, "Side of the window around a feature in pixels, odd", 7, 101)
    levels: int = setting(3, "Number of levels of the image pyramid", 1, 8)
    iterations: int = setting(30, "Largest number of iterations on each level of the pyramid", 1, 100)
    max_bidirectional_px: float = setting(
        1.0, "Largest distance in pixels between a feature and where it is found after it was followed forward and "
        "backward", 0.01, 10.0)
    follow: str = setting(
        "template", "How features are followed: klt (from frame to frame, errors may add up) or template (predicted, "
        "and compared with how they first looked)", choices=FOLLOW)
    min_correlation: float = setting(
        0.6, "With follow template: smallest correlation with how the feature looked first; below, it is followed by "
        "how it looked last", 0.1, 0.99)
    shear_s: float = setting(
        0.5, "With follow template: standard deviation of velocity gradients of the water in 1/s, by which windows are "
        "expected to deform", 0.0, 100.0)
    time_sigma_s: float = setting(0.0, "Standard deviation of the stamp of a frame in seconds", 0.0, 1.0)
    min_track: float = setting(
        0.2, "Shortest track, as a share of extract_s; 1: only features that are seen to the end of the interval",
        0.01, 1.0)
    steadiness: float = setting(
        0.5, "Largest change of velocity within a track, between thirds of it, as a share of its speed (plus what the "
        "noise allows); 0: no limit", 0.0, 10.0)
    local_median: float = setting(
        3.0, "Largest distance from the median of the neighbours, in units of their scatter (Westerweel and Scarano "
        "2005); 0: no limit", 0.0, 100.0)
    local_median_eps: float = setting(
        0.02, "What is added to the scatter of neighbours for the local median, as a share of the median speed",
        0.0, 10.0)
    min_speed: float = setting(0.0, "Smallest speed in m/s (px/s without georeference)", 0.0, 1e6)
    max_speed: float = setting(0.0, "Largest speed in m/s (px/s without georeference); 0: no limit", 0.0, 1e6)
    direction_deg: float = setting(
        0.0, "Direction of the flow in degrees from the x axis (east) towards the y axis (north)", -360.0, 360.0)
    direction_tolerance_deg: float = setting(
        180.0, "Largest angle between a vector and direction_deg; 180: no limit", 0.0, 180.0)
    max_sigma: float = setting(
        0.0, "Largest standard error of a vector by itself (longer axis) in m/s (px/s without georeference); 0: no "
        "limit", 0.0, 1e6)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.block_px % 2 == 0:
            raise ConfigError(f"block_px: {self.block_px} must be odd")
        if self.max_speed and self.max_speed <= self.min_speed:
            raise ConfigError(f"max_speed: {self.max_speed:g} must be above min_speed {self.min_speed:g}")


# Perks 2020, sections 2.1 and 2.2.4, and the settings of the released KLT-IV; v1.0 of the paper does not filter.
_KLT_IV: Mapping[str, Value] = MappingProxyType({
    "method": "particles", "follow": "klt", "selection": "strongest", "features": 20000, "extract_s": 1.0,
    "block_px": 31, "levels": 3, "iterations": 30, "max_bidirectional_px": 1.0, "ignore_edges": 0.1, "min_track": 1.0,
    "steadiness": 0.0, "local_median": 0.0, "min_speed": 0.0, "max_speed": 0.0, "direction_tolerance_deg": 180.0,
    "max_sigma": 0.0,
})
PRESETS: Mapping[str, Mapping[str, Value]] = MappingProxyType({"klt_iv": _KLT_IV})
