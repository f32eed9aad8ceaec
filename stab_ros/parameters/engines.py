"""Makes engines from parameters, for both nodes and commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.geometry import apply
from stab_ros.core.settings import Value
from stab_ros.core.types import Homography
from stab_ros.evaluation.evaluator import Evaluator
from stab_ros.georeferencing.local_frame import LOCAL, LocalFrame, is_projected
from stab_ros.georeferencing.settings import GeoreferenceConfig, needs_sensors, numbers_of
from stab_ros.imaging.camera import Camera
from stab_ros.io.camera_file import CameraFile, moved_to, read_camera_file
from stab_ros.io.camera_profiles import camera_for, profiles
from stab_ros.io.gcp_file import read_gcps
from stab_ros.io.points import read_points, read_tracking_points
from stab_ros.io.regions import read_area
from stab_ros.io.static_maps import read_static_map
from stab_ros.parameters.table import evaluator_config, georeference_config, stabilizer_config
from stab_ros.tracking.stabilizer import Stabilizer

if TYPE_CHECKING:  # imported where needed: with scipy they cost as much as all that a tracker needs
    from stab_ros.georeferencing.gcp_places import PlacedPoints
    from stab_ros.georeferencing.georeferencer import Georeferencer


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
        values: parameters of georeferencing by name; the others keep their defaults, `wse_m` that of the file of the
            camera.
        camera: that takes the images, unless `camera_file` names another; None: of unknown calibration.
        size: width and height of the images as taken, px.
        image_H_ref: (3, 3), for images that are stabilised already: from pixels of the reference to those of the image;
            None: images are as taken.

    Returns:
        The engine.

    Raises:
        InputError: a name is unknown, a value or a file is wrong, or the orientation needs what is not given.
    """
    from stab_ros.georeferencing.georeferencer import Georeferencer
    from stab_ros.georeferencing.orientations import make_orientation
    from stab_ros.georeferencing.sensors import Sensors

    file, remarks = camera_of(values, size)
    file = None if file is None else moved_to(origin_of(values), file)
    if file is not None and file.wse_m is not None and "wse_m" not in values:
        values = {**values, "wse_m": file.wse_m}
    config = georeference_config(values)
    camera = camera if file is None else file.camera
    known = camera or uncalibrated(size)
    if image_H_ref is not None:
        known = Camera(known.K, np.zeros(0), "plumb_bob", known.size)
    gcps = _gcps_of(values, config, file, image_H_ref)
    sensors, frame = Sensors(config.time_offset_s), _frame_of(values, file, gcps)
    if gcps is not None:
        _check_map(values, config, frame)
    points = None if gcps is None else gcps.points
    pose = None if file is None or file.pose is None else (file.pose, file.pose_covariance)
    orientation = make_orientation(config, known, camera is not None, points, sensors, pose)
    doubts = (*remarks, *(() if gcps is None else gcps.doubts))
    return Georeferencer(config, known, orientation, sensors, image_H_ref, points, frame, doubts)


def _check_map(values: Mapping[str, Value], config: GeoreferenceConfig, frame: LocalFrame | None) -> None:
    """Raises ConfigError where control points and fixes are in maps of their own. frame: of the points."""
    if needs_sensors(config) and frame is None:
        raise ConfigError(f"{values['gcps_file']}: local control points and fixes of GPS need one map, give crs (the "
                          "EPSG code of the points), or as origin where on the Earth their 0, 0, 0 lies")


def tells_level(values: Mapping[str, Value]) -> bool:
    """Whether parameters that were given, or the file of the camera, tell the water surface elevation.

    Raises:
        InputError: the file cannot be read.
    """
    name = str(values.get("camera_file", ""))
    if "wse_m" in values or not name or name in profiles():
        return "wse_m" in values
    return read_camera_file(Path(name)).wse_m is not None


def camera_of(values: Mapping[str, Value], size: tuple[int, int]) -> tuple[CameraFile | None, tuple[str, ...]]:
    """The camera that `camera_file` names, scaled to images of this size, and what is doubtful of it; None: none.

    Raises:
        InputError: it cannot be read, or takes images of another shape.
    """
    name = str(values.get("camera_file", ""))
    if not name:
        return None, ()
    file, doubts = camera_for(name, size)
    return file, tuple(doubts)


def _gcps_of(values: Mapping[str, Value], config: GeoreferenceConfig, file: CameraFile | None,
             image_H_ref: Homography | None) -> PlacedPoints | None:
    """The control points of `gcps_file` in the map, their pixels those of the reference if images are stabilised."""
    from stab_ros.georeferencing.gcp_places import placed, survey_crs

    path = str(values.get("gcps_file", ""))
    if not path:
        return None
    table = read_gcps(Path(path))
    pixels = table.image_px if image_H_ref is None else apply(np.linalg.inv(image_H_ref), table.image_px)
    frame = origin_of(values) or (None if file is None else file.frame)
    try:
        found = placed(table.names, pixels, table.places, survey_crs(_asked_crs(values), table.crs, table.geographic),
                       geographic=table.geographic, unit_m=table.unit_m, frame=frame, level_m=config.wse_m)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return replace(found, doubts=tuple(f"{path}: {doubt}" for doubt in (*table.remarks, *found.doubts)))


def _frame_of(values: Mapping[str, Value], file: CameraFile | None, gcps: PlacedPoints | None) -> LocalFrame | None:
    """Where the map is on the Earth, as far as parameters and files tell."""
    known = (origin_of(values), None if gcps is None else gcps.frame, None if file is None else file.frame)
    return next((frame for frame in known if frame is not None), None)


def origin_of(values: Mapping[str, Value]) -> LocalFrame | None:
    """The origin of the map that the parameter `origin` names; None: it names none.

    Raises:
        InputError: it is none.
    """
    text = str(values.get("origin", ""))
    return LocalFrame(*numbers_of("origin", text, 3)) if text.strip() else None


def _asked_crs(values: Mapping[str, Value]) -> str | None:
    crs = str(values.get("crs", LOCAL))
    return None if crs == LOCAL else crs


def _are_local(values: Mapping[str, Value], gcps_file: Path) -> bool:
    """Whether control points are in metres of a map that lies nowhere on the Earth, by themselves."""
    from stab_ros.georeferencing.gcp_places import survey_crs

    table = read_gcps(gcps_file)
    crs = survey_crs(_asked_crs(values), table.crs, table.geographic)
    return not table.geographic and (crs is None or crs.lower() == LOCAL)


def crs_of(values: Mapping[str, Value]) -> str:
    """The projected reference system that `crs`, the control points or the file of the camera name; else "local".

    Raises:
        InputError: a file cannot be read, or names no reference system.
    """
    if "crs" in values:
        return str(values["crs"])
    camera_file, gcps_file = str(values.get("camera_file", "")), str(values.get("gcps_file", ""))
    named = [read_gcps(Path(gcps_file)).crs] if gcps_file else []
    if camera_file and camera_file not in profiles():
        file = read_camera_file(Path(camera_file))
        named += [] if file.frame is None else [file.crs]  # without its place on the Earth, the map is not in that
    return next((crs for crs in named if crs is not None and is_projected(crs)), LOCAL)


def uncalibrated(size: tuple[int, int]) -> Camera:
    """A pinhole camera that stands for an unknown one where its K does not matter."""
    width, height = size
    K = np.array([[max(size), 0, (width - 1) / 2], [0, max(size), (height - 1) / 2], [0, 0, 1]], float)
    return Camera(K, np.zeros(0), "plumb_bob", size)


def check_georeference(values: Mapping[str, Value]) -> None:
    """Refuses what no camera would make right, before the camera is known.

    Args:
        values: parameters of georeferencing by name.

    Raises:
        InputError: as `make_georeferencer`; but whether control points fit the camera is not known yet.
    """
    config = georeference_config(values)
    origin = frame = origin_of(values)
    camera_file, gcps_file = str(values.get("camera_file", "")), str(values.get("gcps_file", ""))
    if camera_file and camera_file not in profiles():
        file = read_camera_file(Path(camera_file))
        moved_to(origin, file)
        frame = origin or file.frame
    if gcps_file:
        if _are_local(values, Path(gcps_file)):
            _check_map(values, config, frame)
    elif not camera_file:
        camera = uncalibrated((640, 480))
        make_georeferencer(values, camera, camera.size)
