"""Discharges that others have published, from their own files, beside what stab_ros makes of the same numbers.

    git clone https://github.com/frank-engel/ivy https://github.com/localdevices/pyorc https://github.com/oruscam/RIVeR
    python bench/discharge/public.py --ivy ivy --pyorc pyorc --river RIVeR --h5py python-with-h5py

Each source may be left out. The files are read and not kept: pyorc is AGPL, RIVeR is AGPL, IVyTools is CC0.
"""

from __future__ import annotations

import argparse
import ast
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.discharge.cross_section import CrossSection, between, referenced
from stab_ros.discharge.integration import mean_section, mid_section
from stab_ros.discharge.measure import measure
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.discharge.wetted import area_m2
from stab_ros.georeferencing.unit_checks import FOOT_M
from stab_ros.velocimetry.vectors import Vectors

_NS = 1_000_000_000


@dataclass(frozen=True)
class Line:
    """One row of the table."""

    what: str
    published: str
    ours: str
    why: str


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("ivy", "pyorc", "river"):
        parser.add_argument(f"--{name}", type=Path, help=f"folder of {name}, checked out")
    parser.add_argument("--h5py", default=sys.executable, help="a Python that has h5py, for pyorc's NetCDF")
    options = parser.parse_args()
    lines: list[Line] = []
    lines += of_field_notes(options.ivy) if options.ivy else []
    lines += of_ngwerere(options.pyorc, options.h5py) if options.pyorc else []
    lines += of_pisco(options.river) if options.river else []
    print("| what | published | stab_ros | why |\n|---|---|---|---|")
    for line in lines:
        print(f"| {line.what} | {line.published} | {line.ours} | {line.why} |")


def of_field_notes(ivy: Path) -> Iterator[Line]:
    """USGS TM3-A8, figure 2: current meter, 28 verticals, in feet."""
    source = ivy / "image_velocimetry_tools/tests/test_discharge.py"
    station, depth, velocity = (_literal(source, name) for name in
                                ("dist_from_start", "vertical_depths", "avg_velocities"))
    metres, depths, speeds = station * FOOT_M, depth * FOOT_M, velocity * FOOT_M
    area = float(area_m2(metres, depths)) / FOOT_M**2
    for name, method in (("mid-section", mid_section), ("mean-section", mean_section)):
        q = float(method(metres, depths, speeds).sum()) / FOOT_M**3
        yield Line(f"USGS TM3-A8 notes, {name}", "73.39 ft3/s, 143.6 ft2", f"{q:.2f} ft3/s, {area:.2f} ft2",
                   "the notes round areas to 0.1, which makes 73.1 to 73.5 and 143.0 to 143.7" if method is mid_section
                   else "another method")


def _literal(source: Path, name: str) -> FloatArray:
    """The first list assigned to a name in a Python file."""
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == name:
            return np.array(ast.literal_eval(node.value), float)
    raise ValueError(f"{source}: no {name}")


_DUMP = """
import sys, h5py, numpy as np
with h5py.File(sys.argv[1]) as f:
    def real(name):
        v = f[name]; raw = v[:]; fill = v.attrs.get("_FillValue")
        scaled = raw * float(np.ravel(v.attrs.get("scale_factor", 1.0))[0])
        return np.where(raw == fill, np.nan, scaled) if fill is not None else scaled
    np.savez(sys.argv[2], **{name: real(name) for name in ("v_x", "v_y", "x", "y", "xs", "ys", "time")})
"""


def of_ngwerere(pyorc: Path, python: str) -> Iterator[Line]:
    """A stream in Zambia from a fixed camera; alpha 0.9, gaps are zeros, as in pyorc's tests."""
    folder = pyorc / "examples/ngwerere"
    survey = np.genfromtxt(folder / "ngwerere_cross_section.csv", delimiter=",", names=True)
    wse_m = 1182.2  # z_0 and h_a = h_ref of the example
    with tempfile.TemporaryDirectory() as scratch:
        table = Path(scratch) / "piv.npz"
        subprocess.run([python, "-c", _DUMP, str(folder / "ngwerere_piv.nc"), str(table)], check=True)
        grid = dict(np.load(table))
    vectors = _of_grid(grid)
    section = referenced(_to_grid(grid, np.column_stack([survey["x"], survey["y"]])), survey["z"])
    config = DischargeConfig(alpha=0.9, verticals=40, search_m=0.2, filling="froude", min_vectors=25)
    found = measure(vectors, section, wse_m, config)
    single = _single_pairs(vectors, section, wse_m, config)
    yield Line("pyorc ngwerere, alpha 0.9", "0.078 to 0.082 m3/s (first 2 pairs)", _said(found),
               f"all 125 pairs; single pairs from {single.min():.3f} to {single.max():.3f}, the first two "
               f"{single[0]:.3f} and {single[1]:.3f}")


def _single_pairs(vectors: Vectors, section: CrossSection, wse_m: float, config: DischargeConfig) -> FloatArray:
    """The discharge by each pair of frames alone."""
    alone = replace(config, min_vectors=1, draws=100)
    stamps = np.unique(vectors.start_ns)
    return np.array([measure(vectors[vectors.start_ns == stamp], section, wse_m, alone).q_m3_s for stamp in stamps])


def _of_grid(grid: dict[str, FloatArray]) -> Vectors:
    """Each pair of frames and cell is a vector of its own."""
    x, y = np.meshgrid(grid["x"], grid["y"])
    times, rows, columns = np.nonzero(np.isfinite(grid["v_x"]) & np.isfinite(grid["v_y"]))
    velocity = np.column_stack([grid[name][times, rows, columns] for name in ("v_x", "v_y")])
    middle = np.column_stack([x[rows, columns], y[rows, columns]])
    start_ns = (grid["time"][times] * _NS).astype(np.int64)
    return _vectors(middle, velocity, start_ns, np.arange(len(times), dtype=np.int64))


def _to_grid(grid: dict[str, FloatArray], map_m: FloatArray) -> FloatArray:
    """Places in the coordinates of the grid, by the affine map that its own two sets of coordinates tell."""
    x, y = np.meshgrid(grid["x"], grid["y"])
    centre = np.array([grid["xs"].mean(), grid["ys"].mean()])
    design = np.column_stack([grid["xs"].ravel() - centre[0], grid["ys"].ravel() - centre[1], np.ones(x.size)])
    affine, *_ = np.linalg.lstsq(design, np.column_stack([x.ravel(), y.ravel()]), rcond=None)
    return np.asarray(np.column_stack([map_m - centre, np.ones(len(map_m))]) @ affine)


def of_pisco(river: Path) -> Iterator[Line]:
    """A river in Peru from RIVeR's example 05: 15 stations, alpha 1, median PIV field, Froude filling."""
    folder = river / "examples/results/pisco"
    section = json.loads((folder / "section.json").read_text())["section1"]
    to_map = np.array(json.loads((folder / "transformation.json").read_text()))
    piv = json.loads((folder / "piv_results.json").read_text())
    bed = np.genfromtxt(river / "examples/data/bathymetry/pisco_section.csv", delimiter=",", names=True)
    between_frames_s = 2 / 25
    at_px = np.column_stack([piv["x"], piv["y"]]).astype(float)
    moved_px = at_px + np.column_stack([piv["u_median"], piv["v_median"]]).astype(float)
    seen = np.isfinite(moved_px).all(axis=1)
    start, end = (_mapped(to_map, px[seen]) for px in (at_px, moved_px))
    velocity = (end - start) / between_frames_s
    vectors = _vectors(start, velocity, np.zeros(len(start), np.int64),
                       np.arange(len(start), dtype=np.int64))
    line = between(np.array([section["east_l"], section["north_l"]]),
                   np.array([section["east_r"], section["north_r"]]), bed["d"], bed["h"])
    config = DischargeConfig(alpha=1.0, verticals=13, search_m=1.2, min_vectors=1, alpha_sigma=0.0, filling="froude")
    found = measure(vectors, line, section["level"], config)
    yield Line("RIVeR pisco, alpha 1", "50.52 +- 9.09 m3/s", _said(found),
               "median within 1.2 m in place of the linear interpolation of the field")


def _mapped(to_map: FloatArray, px: FloatArray) -> FloatArray:
    places = np.column_stack([px, np.ones(len(px))]) @ to_map.T
    return np.asarray(places[:, :2] / places[:, 2:])


def _vectors(middle_m: FloatArray, velocity_m_s: FloatArray, start_ns: IdArray, track_id: IdArray) -> Vectors:
    """Vectors of a second around their middles, without covariance: their scatter tells the error."""
    n = len(middle_m)
    return Vectors(middle_m - velocity_m_s / 2, middle_m + velocity_m_s / 2, start_ns, start_ns + _NS,
                   np.zeros((n, 2, 2)), np.zeros((n, 2, 0)), track_id)


def _said(found: Discharge) -> str:
    return (f"{found.q_m3_s:.4g} m3/s, 95 % {found.low_m3_s:.4g} to {found.high_m3_s:.4g}, measured "
            f"{found.shares.measured:.0%}")


if __name__ == "__main__":
    main()
