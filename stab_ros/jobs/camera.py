"""The fit of a camera to ground control points: what `stab-ros camera` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import KnownPosition, Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.coordinate_checks import Fitter, below_points, below_text, fit_as_read
from stab_ros.georeferencing.gcp_places import PlacedPoints, check_inside, placed, survey_crs
from stab_ros.georeferencing.leave_one_out import leave_one_out
from stab_ros.georeferencing.plane_fit import PlaneFit, fit_plane
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.georeferencing.unit_checks import distance_m, length_doubt, position_doubt
from stab_ros.io.camera_file import CameraFile
from stab_ros.io.camera_profiles import camera_for
from stab_ros.io.compressed_image import MAX_DECODED, decode_file
from stab_ros.io.gcp_file import read_gcps
from stab_ros.io.gcp_file_table import GcpTable
from stab_ros.io.image_names import IMAGE_SUFFIXES
from stab_ros.io.source import open_source


@dataclass(frozen=True, eq=False)
class CameraJob:
    """What is fitted, to what.

    Attributes:
        gcps: file of control points.
        image: picture, video or bag in which they were marked.
        camera: path of a camera file or name of a profile; None: not known.
        focals: number of focal lengths where the camera is not known.
        k1: whether the first lens coefficient is fitted.
        plane: fit the homography to the water plane only.
        position: (3,), place of the camera as the file writes places; None: not known.
        position_sigma_m: its standard deviation; 0: it is kept.
        crs: reference system of the survey, or beside latitudes and longitudes a projected one for orthophotos; None:
            as the file says, else local.
        wse_m: water surface elevation, in the heights of the survey; None: not known.
        height_m: known height of the camera above the water; None: not known.
        distance: names of two control points and their distance, m; None: not known.
        noise: of the points.
    """

    gcps: Path
    image: Path
    camera: str | None = None
    focals: int = 1
    k1: bool = False
    plane: bool = False
    position: FloatArray | None = None
    position_sigma_m: float = 0.0
    crs: str | None = None
    wse_m: float | None = None
    height_m: float | None = None
    distance: tuple[str, str, float] | None = None
    noise: PointNoise = field(default_factory=PointNoise)


@dataclass(frozen=True, eq=False)
class FittedCamera:
    """What came out.

    Attributes:
        fit: of a camera, or of the plane.
        file: for `write_camera_file`; None for a plane.
        left_out: residuals of `leave_one_out`, px and m.
        warnings: one line each.
    """

    fit: CameraFit | PlaneFit
    file: CameraFile | None
    left_out: tuple[FloatArray, FloatArray]
    warnings: tuple[str, ...]


def fit_from_files(job: CameraJob) -> FittedCamera:
    """Reads control points and picture, and fits.

    Raises:
        InputError: a file cannot be read, or the points do not tell what is asked.
    """
    table, size = read_gcps(job.gcps), image_size(job.image)
    known, said = camera_for(job.camera, size) if job.camera else (None, [])
    where = placed(table.names, table.image_px, table.places, survey_crs(job.crs, table.crs, table.geographic),
                   geographic=table.geographic, unit_m=table.unit_m, level_m=job.wse_m)
    check_inside(where.points, size)
    position = _position(job, table, where)
    doubts = _position_doubts(job, where.points, position, _fitter(job, size, known, None))
    fit = _fitted(job, where.points, size, _fitter(job, size, known, position), doubts)
    _check_water(job, fit)
    doubts += _below_doubts(job, fit) + _length_doubts(job, fit)
    warnings = [*table.remarks, *where.doubts, *said, *fit.warnings, *doubts]
    return FittedCamera(fit, _file(job, fit, where, known), leave_one_out(fit), tuple(warnings))


def image_size(path: Path) -> tuple[int, int]:
    """Width and height, px, of a picture, or of the first one of a video, folder or bag.

    Raises:
        InputError: it cannot be read.
    """
    if not path.name.lower().endswith(IMAGE_SUFFIXES):
        with open_source(path) as source:
            decoded = next((picture.decoded for picture in source.frames(1)), None)
        if decoded is None or isinstance(decoded, MessageError):
            raise InputError(f"{path}: its first image cannot be read, give a picture")
        return decoded.size
    try:
        image = decode_file(np.fromfile(path, np.uint8, MAX_DECODED))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; it must be the picture in which the points were marked") from error
    except (ValueError, MessageError) as error:
        raise InputError(f"{path}: is no picture that can be read ({error})") from error
    return image.shape[1], image.shape[0]


def _fitter(job: CameraJob, size: tuple[int, int], known: CameraFile | None, position: KnownPosition | None) -> Fitter:
    """The fit that is asked for, as a function of points."""
    camera = known.camera if known else None
    if job.plane:
        return lambda points: fit_plane(points, job.wse_m, camera=camera, noise=job.noise)
    if known is not None and not known.nominal:
        unknowns = Unknowns(focals=0, k1=job.k1)
        return lambda points: fit_camera(points, size, unknowns, camera=camera, noise=job.noise, known=position)
    unknowns = Unknowns(focals=job.focals, k1=job.k1)

    def fit(points: ControlPoints) -> CameraFit:
        try:
            return fit_camera(points, size, unknowns, camera=camera, noise=job.noise, known=position)
        except InputError as error:
            if camera is None:
                raise
            pose = fit_pose(points, camera, noise=job.noise, known=position)
            return replace(pose, warnings=(*pose.warnings, f"the nominal focal length is taken as it is: {error}"))
    return fit


def _fitted(job: CameraJob, points: ControlPoints, size: tuple[int, int], fit_to: Fitter, doubts: Sequence[str]
            ) -> CameraFit | PlaneFit:
    """The fit, or what explains that it is bad."""
    try:
        return fit_as_read(points, size, fit_to, lambda: _plane_instead(job, points))
    except InputError as error:
        raise InputError("; ".join([f"{job.gcps}: {error}", *doubts])) from error


def _plane_instead(job: CameraJob, points: ControlPoints) -> str | None:
    """Advice for points that lie in the plane of the water, which tell that plane better than a camera."""
    if job.plane:
        return None
    try:
        fit = fit_plane(points, job.wse_m, noise=job.noise)
    except InputError:  # they tell that neither
        return None
    return None if fit.wrong or fit.warnings else "--plane fits the homography of their plane"


def _position(job: CameraJob, table: GcpTable, where: PlacedPoints) -> KnownPosition | None:
    if job.position is None:
        return None
    given = job.position[None, [1, 0, 2]] if table.geographic else job.position[None]
    place = given if where.frame is None else where.frame.from_crs(where.crs, given)
    return KnownPosition(place[0], job.position_sigma_m)


def _check_water(job: CameraJob, fit: CameraFit | PlaneFit) -> None:
    if job.wse_m is not None and isinstance(fit, CameraFit) and not fit.view.pose.position_m[2] > job.wse_m:
        up_m = fit.view.pose.position_m[2]
        raise InputError(f"the water surface at {job.wse_m:g} m is not below the camera, which the points put at "
                         f"{up_m:.2f} m; both must have one height datum, and metres")


def _below_doubts(job: CameraJob, fit: CameraFit | PlaneFit) -> list[str]:
    """Doubts a camera below all points; raises InputError unless the water is known to be below it."""
    if isinstance(fit, PlaneFit) or not below_points(fit):
        return []
    if job.wse_m is None:
        raise InputError(f"{job.gcps}: {below_text(fit)}; if it is so, give the water surface elevation")
    return [below_text(fit)]


def _length_doubts(job: CameraJob, fit: CameraFit | PlaneFit) -> list[str]:
    found = []
    if job.distance is not None:
        first, second, given_m = job.distance
        what = f"the distance from {first} to {second}"
        found.append(length_doubt(what, distance_m(fit.points, first, second), given_m))
    if job.height_m is not None and isinstance(fit, CameraFit):
        level_m = float(fit.points.map_m[:, 2].mean()) if job.wse_m is None else job.wse_m
        height_m = float(fit.view.pose.position_m[2]) - level_m
        found.append(length_doubt("the height of the camera above the water", height_m, job.height_m))
    return [doubt for doubt in found if doubt]


def _position_doubts(job: CameraJob, points: ControlPoints, position: KnownPosition | None, fit_to: Fitter
                     ) -> list[str]:
    """Compares a position that was given with the one that the points tell."""
    if position is None:
        return []
    try:
        free = fit_to(points)
    except InputError:  # they tell none, which is why it was given
        return []
    if isinstance(free, PlaneFit):
        return []
    sigma_m = float(np.sqrt(np.trace(free.pose_covariance[:3, :3])))
    doubt = position_doubt(points, free.view.pose.position_m, sigma_m + job.position_sigma_m, position.position_m)
    return [doubt] if doubt else []


def _file(job: CameraJob, fit: CameraFit | PlaneFit, where: PlacedPoints, known: CameraFile | None
          ) -> CameraFile | None:
    if isinstance(fit, PlaneFit):
        return None
    about = {"fit": {"rmse_px": fit.rmse_px, "rmse_m": fit.rmse_m, "aic": fit.aic, "points": len(fit.points),
                     "wrong_points": list(fit.wrong), "gcps": str(job.gcps)}}
    name = known.name if known else "camera"
    nominal = known.nominal if known and not fit.unknowns.focals else 0.0
    return CameraFile(fit.view.camera, name, nominal, fit.view.pose, fit.pose_covariance, fit.unknowns.names,
                      fit.covariance, job.crs or where.crs, where.frame, job.wse_m, about)
