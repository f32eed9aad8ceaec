"""Makes the engines of velocimetry from parameters, for node and command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Value
from stab_ros.core.types import BoolArray, Homography
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.imaging.camera import Camera
from stab_ros.io.camera_file import read_camera_file
from stab_ros.io.camera_profiles import profiles
from stab_ros.io.lines import read_lines
from stab_ros.io.regions import read_area
from stab_ros.io.static_maps import read_static_map
from stab_ros.parameters.engines import camera_of, check_georeference, make_georeferencer, uncalibrated
from stab_ros.parameters.table import (
    GEOREFERENCE_PARAMETERS,
    OWN_VELOCITY_PARAMETERS,
    georeference_config,
    lspiv_config,
    stiv_config,
    velocity_config,
)
from stab_ros.tracking.static_map import StaticMap
from stab_ros.velocimetry.lspiv import Lspiv
from stab_ros.velocimetry.particles import Particles
from stab_ros.velocimetry.pictures import Stream
from stab_ros.velocimetry.pixel_plane import PixelPlane
from stab_ros.velocimetry.shore import off_ground
from stab_ros.velocimetry.stiv import Stiv
from stab_ros.velocimetry.vectors import Unit
from stab_ros.velocimetry.velocimeter import MakeMethod, Velocimeter

_PLACES = ("orientation", "gcps_file", "height_m", "known_distance", "gsd_m")  # any of them tells of metres
_SCALES = ("gsd_m", "known_distance", "height_m")  # of a nadir reference
_SCALED_VIEWS = ("stationary_nadir", "dynamic_stabilization")  # whose scale is not that of a water level
GROUND = 128  # of a static map
_BANK_FEATURES = 300  # at most: they only check


def georeference_values(values: Mapping[str, Value]) -> dict[str, Value]:
    """The parameters of georeferencing among those of velocimetry; a scale alone is one of a nadir reference."""
    own = {name: value for name, value in values.items() if name in GEOREFERENCE_PARAMETERS}
    if "orientation" not in own and not own.get("gcps_file") and any(own.get(name) for name in _SCALES):
        own["orientation"] = "dynamic_stabilization"
    return own


def unit_of(values: Mapping[str, Value]) -> Unit:
    """Metres where parameters, or a camera.yaml with a pose, tell where frames lie; else pixels of the reference.

    Raises:
        InputError: the camera file cannot be read.
    """
    if any(values.get(name) for name in _PLACES):
        return "m"
    name = str(values.get("camera_file", ""))
    has_pose = bool(name) and name not in profiles() and read_camera_file(Path(name)).pose is not None
    return "m" if has_pose else "px"


def stream_config(values: Mapping[str, Value]) -> GeoreferenceConfig:
    """The settings of georeferencing; for lengths in pixels, frames are placed by their homographies.

    Raises:
        InputError: a value or the camera file is wrong.
    """
    own = georeference_values(values)
    return georeference_config(own if unit_of(values) == "m" else {**own, "orientation": "dynamic_stabilization"})


def make_placer(values: Mapping[str, Value], camera: Camera | None, size: tuple[int, int],
                image_H_ref: Homography | None = None) -> Georeferencer:
    """The engine that places the frames of a stream, on the water or on the reference; see `make_georeferencer`.

    Raises:
        InputError: as there.
    """
    if unit_of(values) == "m":
        return make_georeferencer(georeference_values(values), camera, size, image_H_ref)
    file, remarks = camera_of(values, size)
    known = (camera if file is None else file.camera) or uncalibrated(size)
    if image_H_ref is not None:
        known = Camera(known.K, np.zeros(0), "plumb_bob", known.size)
    return Georeferencer(stream_config(values), known, PixelPlane(), Sensors(0.0), image_H_ref, doubts=tuple(remarks))


def check_velocimetry(values: Mapping[str, Value]) -> None:
    """Refuses what no camera would make right, before the first frame.

    Args:
        values: parameters of velocimetry by name.

    Raises:
        InputError: as `make_velocimeter`, `make_placer` and `read_static_map`.
    """
    make_velocimeter(values, Stream())
    read_static_map(values)
    stream_config(values)
    if unit_of(values) == "m":
        check_georeference(georeference_values(values))


def make_velocimeter(values: Mapping[str, Value], stream: Stream, ground: StaticMap | None = None) -> Velocimeter:
    """The engine that measures velocities where they are wanted.

    Args:
        values: parameters of velocimetry by name; the others keep their defaults.
        stream: what is known of its frames.
        ground: static map of the first reference, whose ground is left out, and for particles what windows of
            features show with it; None: nothing is.

    Raises:
        InputError: a name is unknown, or a value or a region is wrong.
    """
    make_method, area, config = _method_maker(values, stream.unit), read_area(values), velocity_config(values)
    block_px = config.block_px if config.method == "particles" else 1

    def allowed(size: tuple[int, int], first: bool) -> BoolArray | None:
        left_out = ground if first else None
        if area.roi is None and area.exclude is None and left_out is None:
            return None
        wanted = area.allowed(size)
        if left_out is not None:
            left_out.check_size(size)
            wanted &= off_ground(left_out.picture() >= GROUND, block_px)
        return wanted

    level_scales = stream_config(values).orientation not in _SCALED_VIEWS
    return Velocimeter(replace(stream, level_scales=level_scales), make_method, allowed)


def takes_map(values: Mapping[str, Value]) -> bool:
    """Whether the static map of the tracker tells where the water is."""
    default = OWN_VELOCITY_PARAMETERS["leave_out_bank"].default
    return not values.get("static_map") and bool(values.get("leave_out_bank", default))


def _method_maker(values: Mapping[str, Value], unit: Unit) -> MakeMethod:
    """Makes the method that the parameters name.

    Raises:
        InputError: a value is wrong, or lines are missing.
    """
    config = velocity_config(values)
    if config.method == "lspiv":
        by_correlation = lspiv_config(values)
        return lambda zone: Lspiv(by_correlation, unit, zone.outlines())
    if config.method == "stiv":
        along, lines = stiv_config(values), read_lines(values)
        if not lines:
            raise ConfigError("method stiv measures along lines, give them as lines")
        return lambda _zone: Stiv(along, lines, unit)
    return lambda zone: Particles(config, zone.mask, unit)


def make_bank_check(values: Mapping[str, Value], stream: Stream, ground: StaticMap) -> Velocimeter:
    """The engine that measures the bank, which must not move: by particles, with few features and no limit of speed.

    Args:
        values: as for `make_velocimeter`.
        stream: what is known of its frames.
        ground: the static map of the reference.

    Raises:
        InputError: a name is unknown, or a value is wrong.
    """
    given: dict[str, Value] = {name: value for name, value in values.items() if name not in (
        "min_speed", "direction_tolerance_deg", "local_median", "steadiness", "method")}
    features = min(velocity_config(given).features, _BANK_FEATURES)
    config = velocity_config({**given, "features": features, "local_median": 0.0, "steadiness": 0.0})

    def allowed(size: tuple[int, int], first: bool) -> BoolArray:
        if not first:
            return np.zeros(size[::-1], bool)
        ground.check_size(size)
        inner = np.ones((config.block_px, config.block_px), np.uint8)  # windows there show no water
        return np.asarray(cv2.erode(ground.picture(), inner) >= GROUND)

    return Velocimeter(stream, lambda zone: Particles(config, zone.mask, stream.unit), allowed)
