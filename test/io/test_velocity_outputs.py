"""Velocity vectors as messages, GeoJSON and NetCDF; what is written is read by other libraries."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from scipy.io import netcdf_file
from sensor_msgs.msg import PointCloud2
from velocities import random_vectors

from stab_ros.core.errors import MessageError, WorkError
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.cdr import Header
from stab_ros.io.point_cloud import cloud_cdr, read_cloud
from stab_ros.io.velocity_geojson import write_tracks
from stab_ros.io.velocity_grid_netcdf import TimedGrid, write_grid_netcdf
from stab_ros.io.velocity_message import read_surface, read_velocity, velocity_cdr
from stab_ros.io.velocity_netcdf import write_netcdf
from stab_ros.velocimetry.grid import on_grid
from stab_ros.velocimetry.vectors import Vectors

_HEADER = Header(3_000_000_007, "map")


def test_messages_come_back() -> None:
    vectors = random_vectors(9)
    header, read = read_velocity(velocity_cdr(vectors, 12.5, _HEADER))
    assert header == _HEADER
    for name in ("start_m", "start_ns", "end_ns", "covariance", "shared"):
        np.testing.assert_array_equal(getattr(read, name), getattr(vectors, name))
    np.testing.assert_allclose(read.end_m, vectors.end_m, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(read.track_id, vectors.track_id % 2**32)


def test_ros_reads_the_fields() -> None:
    vectors = random_vectors(5)
    message: Any = deserialize_message(velocity_cdr(vectors, 12.5, _HEADER), PointCloud2)
    assert (message.width, message.height, message.header.frame_id) == (5, 1, "map")
    names = [field.name for field in message.fields]
    assert names[:9] == ["x", "y", "z", "vx", "vy", "var_vx", "var_vy", "cov_vxvy", "dt"]
    offset = message.fields[names.index("vx")].offset
    vx = [np.frombuffer(bytes(message.data), "<f8", 1, row * message.point_step + offset)[0] for row in range(5)]
    np.testing.assert_array_equal(vx, vectors.velocity_m_s[:, 0])


def test_the_level_whose_scale_the_vectors_have() -> None:
    assert read_surface(velocity_cdr(random_vectors(2), 12.5, _HEADER)) == 12.5
    assert read_surface(velocity_cdr(random_vectors(2), 0.0, _HEADER)) == 0.0
    assert read_surface(velocity_cdr(random_vectors(2), 0.0, _HEADER, np.nan)) is None
    assert read_surface(velocity_cdr(random_vectors(0), 12.5, _HEADER)) is None


@pytest.mark.parametrize(("z_m", "surface_m"), [(12.5, 12.5), (0.0, None)])
def test_older_messages_have_the_scale_of_their_surface_where_it_was_told(z_m: float, surface_m: float | None) -> None:
    assert read_surface(cloud_cdr(np.full(3, z_m, [("z", "<f8")]), _HEADER)) == surface_m


def test_no_vectors_are_a_message_too() -> None:
    _, read = read_velocity(velocity_cdr(random_vectors(0), 0, _HEADER))
    assert len(read) == 0


@pytest.mark.parametrize("order", ["<", ">"])
def test_clouds_of_either_byte_order(order: str) -> None:
    table = np.array([(1.5, 7), (2.5, 2**32 - 1)], [("a", f"{order}f4"), ("b", f"{order}u4")])
    _, read = read_cloud(cloud_cdr(table, _HEADER))
    assert read.tolist() == table.tolist()


def test_damaged_clouds_are_refused() -> None:
    cdr = velocity_cdr(random_vectors(4), 0, _HEADER)
    for end in range(0, len(cdr), 7):
        with pytest.raises(MessageError):
            read_velocity(cdr[:end])
    with pytest.raises(MessageError, match="without the field x"):
        read_velocity(cloud_cdr(np.zeros(2, [("a", "<f8")]), _HEADER))
    broken = random_vectors(4)
    broken.covariance[0, 0, 0] = np.nan
    with pytest.raises(MessageError, match="not finite"):
        read_velocity(velocity_cdr(broken, 0, _HEADER))


def _lines(path: Path) -> tuple[str, np.ndarray[Any, Any], list[dict[str, float]]]:
    document = json.loads(path.read_text())
    features = document["features"]
    lines = np.array([feature["geometry"]["coordinates"] for feature in features])
    return document["coordinates"], lines, [feature["properties"] for feature in features]


def test_tracks_in_the_map(tmp_path: Path) -> None:
    vectors = random_vectors(6)
    write_tracks(tmp_path / "T.geojson", vectors)
    kind, lines, properties = _lines(tmp_path / "T.geojson")
    assert kind == "metres in the map, east and north"
    np.testing.assert_array_equal(lines, np.stack([vectors.start_m, vectors.end_m], axis=1))
    assert [one["vx_m_s"] for one in properties] == vectors.velocity_m_s[:, 0].tolist()
    assert [one["track_id"] for one in properties] == vectors.track_id.tolist()


def test_tracks_on_the_earth(tmp_path: Path) -> None:
    vectors, frame = random_vectors(6), LocalFrame(46.3, 7.5, 500.0)
    write_tracks(tmp_path / "T.geojson", vectors, 3.0, frame)
    kind, lines, _ = _lines(tmp_path / "T.geojson")
    geodetic = np.column_stack([lines[:, 0, ::-1], np.full(6, 503.0)])
    assert kind == "WGS 84"
    np.testing.assert_allclose(frame.from_geodetic(geodetic)[:, :2], vectors.start_m, atol=1e-6)


def test_grid_as_netcdf(tmp_path: Path) -> None:
    """An interval without vectors is a time without numbers; places on the Earth are those of the cells."""
    frame = LocalFrame(46.3, 7.5, 500.0)
    grids = [TimedGrid(stamp_ns, 2.0, on_grid(random_vectors(n, seed=n), 2.0))
             for stamp_ns, n in ((10**9, 40), (2 * 10**9, 0), (3 * 10**9 + 7, 9))]
    write_grid_netcdf(tmp_path / "G.nc", grids, "m", frame)
    opened: Any = netcdf_file(tmp_path / "G.nc", "r", mmap=False)
    with opened as file:
        assert file.variables["vx"].dimensions == ("time", "y", "x")
        assert set(file.variables["vx"].coordinates.decode().split()) == {"z", "lat", "lon"}
        assert [int(count.sum()) for count in file.variables["count"][:]] == [40, 0, 9]
        assert np.isnan(file.variables["vx"][1]).all()
        x, y = np.meshgrid(file.variables["x"][:], file.variables["y"][:])
        earth = np.column_stack([file.variables["lat"][:].ravel(), file.variables["lon"][:].ravel(),
                                 np.full(x.size, 502.0)])
    np.testing.assert_allclose(frame.from_geodetic(earth)[:, :2], np.column_stack([x.ravel(), y.ravel()]), atol=1e-6)


@pytest.mark.parametrize("grids", [[], [TimedGrid(10**9, 0.0, on_grid(random_vectors(0), 1.0))]])
def test_grid_without_vectors(tmp_path: Path, grids: list[TimedGrid]) -> None:
    write_grid_netcdf(tmp_path / "G.nc", grids, "px")
    opened: Any = netcdf_file(tmp_path / "G.nc", "r", mmap=False)
    with opened as file:
        assert file.variables["count"][:].sum() == 0


def test_a_grid_in_pixels_has_no_elevation(tmp_path: Path) -> None:
    write_grid_netcdf(tmp_path / "G.nc", [TimedGrid(10**9, 0.0, on_grid(random_vectors(9, 0, "px"), 2.0))], "px")
    opened: Any = netcdf_file(tmp_path / "G.nc", "r", mmap=False)
    with opened as file:
        assert file.variables["count"][:].sum() == 9
        assert "z" not in file.variables
        assert not hasattr(file.variables["vx"], "coordinates")


def test_a_huge_grid_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WorkError, match="grid_m must be larger"):
        write_grid_netcdf(tmp_path / "G.nc", [TimedGrid(1, 0.0, on_grid(random_vectors(9), 1e-4))], "m")


@pytest.mark.parametrize("vectors", [random_vectors(6), random_vectors(6, 0, "px"), random_vectors(0)])
def test_netcdf(tmp_path: Path, vectors: Vectors) -> None:
    write_netcdf(tmp_path / "V.nc", vectors, 2.0, LocalFrame(46.3, 7.5, 500.0) if vectors.unit == "m" else None)
    opened: Any = netcdf_file(tmp_path / "V.nc", "r", mmap=False)
    with opened as file:
        assert file.Conventions == b"CF-1.8"
        np.testing.assert_array_equal(file.variables["vx"][:], vectors.velocity_m_s[:, 0])
        if vectors.shared.shape[2]:
            np.testing.assert_array_equal(file.variables["shared_vy"][:], vectors.shared[:, 1])
        seconds = file.variables["time_end"][:] - file.variables["time_start"][:]
        np.testing.assert_allclose(seconds, vectors.dt_s, atol=1e-12)
        assert file.variables["time"].units.startswith(b"seconds since 1970-01-01 00:00:0")
        assert set(file.variables["vx"].coordinates.decode().split()) <= set(file.variables)
