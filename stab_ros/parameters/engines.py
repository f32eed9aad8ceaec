"""Makes engines from parameters, for both nodes and commands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stab_ros.core.settings import Value
from stab_ros.core.types import Homography
from stab_ros.evaluation.evaluator import Evaluator
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import numbers_of
from stab_ros.imaging.camera import Camera
from stab_ros.io.points import read_points, read_tracking_points
from stab_ros.io.regions import read_area
from stab_ros.io.static_maps import read_static_map
from stab_ros.parameters.table import evaluator_config, georeference_config, stabilizer_config
from stab_ros.tracking.stabilizer import Stabilizer


def make_stabilizer(values: Mapping[str, Value], camera: Camera | None = None) -> Stabilizer:
    """Makes a stabiliser from parameters.

    Args:
        values: parameters of the tracker by name; the others keep their defaults, or those of the preset.
        camera: the lens whose distortion is removed first; None: frames are taken as they are.

    Returns:
        The stabiliser.

    Raises:
        InputError: a name is unknown, or a value, a region or the points are wrong.
    """
    return Stabilizer(stabilizer_config(values), read_area(values), camera, read_tracking_points(values),
                      read_static_map(values))


def reconfigure(stabilizer: Stabilizer, values: Mapping[str, Value]) -> None:
    """Changes the settings to those that `make_stabilizer` would use; unchanged on an error.

    Raises:
        InputError: a value, a region or the points are invalid, or do not fit the reference.
    """
    stabilizer.reconfigure(stabilizer_config(values), read_area(values), read_tracking_points(values))


def make_evaluator(values: Mapping[str, Value]) -> Evaluator:
    """Makes an evaluator from parameters.

    Args:
        values: parameters of the evaluator by name; the others keep their defaults.

    Returns:
        The evaluator.

    Raises:
        InputError: a name is unknown, or a value, a region or the file of points is wrong.
    """
    points_file = values.get("points_file", "")
    points = read_points(Path(str(points_file))) if points_file else ()
    return Evaluator(evaluator_config(values), points, read_area(values))


def make_georeferencer(values: Mapping[str, Value], camera: Camera | None, size: tuple[int, int],
                       image_H_ref: Homography | None = None) -> Georeferencer:
    """Makes the engine of georeferencing from parameters.

    Args:
        values: parameters of georeferencing by name; the others keep their defaults.
        camera: that takes the images; None: of unknown calibration.
        size: width and height of the images as taken, px.
        image_H_ref: (3, 3), for images that are stabilised already: from pixels of the reference to those of the image;
            None: images are as taken.

    Returns:
        The engine.

    Raises:
        InputError: a name is unknown, a value or a file is wrong, or the orientation needs what is not given.
    """
    config = georeference_config(values)
    known = camera or uncalibrated(size)
    if image_H_ref is not None:
        known = Camera(known.K, np.zeros(0), "plumb_bob", known.size)
    sensors, local_frame = Sensors(config.time_offset_s), origin_of(values)
    orientation = make_orientation(config, known, camera is not None, None, sensors)
    return Georeferencer(config, known, orientation, sensors, image_H_ref, local_frame=local_frame)


def origin_of(values: Mapping[str, Value]) -> LocalFrame | None:
    """The origin of the map that the parameter `origin` names; None: it names none.

    Raises:
        InputError: it is none.
    """
    text = str(values.get("origin", ""))
    return LocalFrame(*numbers_of("origin", text, 3)) if text.strip() else None


def uncalibrated(size: tuple[int, int]) -> Camera:
    """A pinhole camera that stands for an unknown one where its K does not matter."""
    width, height = size
    K = np.array([[max(size), 0, (width - 1) / 2], [0, max(size), (height - 1) / 2], [0, 0, 1]], float)
    return Camera(K, np.zeros(0), "plumb_bob", size)
