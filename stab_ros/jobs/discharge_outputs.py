"""The files of a discharge: JSON, a table of its verticals, and a page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from stab_ros.core.settings import settings_of
from stab_ros.core.text import number
from stab_ros.discharge.rating import Rating
from stab_ros.discharge.result import Discharge
from stab_ros.evaluation.summary import Json
from stab_ros.jobs.discharge import MeasuredDischarge
from stab_ros.jobs.evaluate_files import write_table, write_tree
from stab_ros.jobs.result_outputs import Writers

_COLUMNS = ("x_m", "y_m", "chainage_m", "bed_m", "depth_m", "channel", "vectors", "measured", "surface_m_s",
            "along_m_s", "sigma_m_s", "mean_m_s", "part_m3_s")


def writers_of(measured: MeasuredDischarge, rating: Rating | str | None) -> Writers:
    """The writers of JSON, CSV and page."""
    tree = as_json(measured, rating)
    return Writers(partial(write_tree, tree), partial(_write_csv, measured),
                   partial(_write_page, measured, rating, tree))


def as_json(measured: MeasuredDischarge, rating: Rating | str | None = None) -> Json:
    """All figures; null where there is none."""
    found, job = measured.discharge, measured.job
    return {
        "velocity": str(job.velocity), "section": str(job.section), **_figures(found), "level": measured.level,
        "settings": {name: getattr(job.config, name) for name, _, _ in settings_of(job.config)},
        "sources_m3_s": dict(found.sources_m3_s), "verticals": [dict(row) for row in _rows(measured)],
        "warnings": list(measured.warnings), "rating": rating_json(rating)}


def _figures(found: Discharge) -> Json:
    return {
        "q_m3_s": found.q_m3_s, "sigma_m3_s": found.sigma_m3_s, "low_m3_s": found.low_m3_s,
        "high_m3_s": found.high_m3_s,
        "measured_share": found.shares.measured, "interpolated_share": found.shares.interpolated,
        "extrapolated_share": found.shares.extrapolated, "measured_width_share": found.measured_width_share,
        "wse_m": found.wse_m, "area_m2": found.area_m2,
        "width_m": found.width_m, "mean_m_s": found.mean_m_s, "iso_sigma": _finite(found.iso_sigma),
        "ive_sigma": _finite(found.ive_sigma), "search_m": found.search_m, "vectors": found.vectors,
        "downstream": found.downstream.tolist(), "start_ns": found.start_ns, "end_ns": found.end_ns}


def rating_json(rating: Rating | str | None) -> Json | None:
    """The curve; its reason where there is none yet."""
    if rating is None or isinstance(rating, str):
        return None if rating is None else {"reason": rating}
    q, relative = rating.at(np.array([one.stage_m for one in rating.gaugings]))
    return {
        "a": rating.a, "b": rating.b, "h0_m": rating.h0_m, "covariance": rating.covariance.tolist(),
        "shared": rating.shared.tolist(), "shared_sigma": rating.shared_sigma, "scatter": rating.scatter,
        "warnings": list(rating.warnings),
        "gaugings": [{"stage_m": one.stage_m, "q_m3_s": one.q_m3_s, "sigma_m3_s": one.sigma_m3_s, "own_sigma": one.own,
                      "source": one.source, "curve_m3_s": float(curve), "curve_sigma": float(sigma)}
                     for one, curve, sigma in zip(rating.gaugings, q, relative, strict=True)]}


def _rows(measured: MeasuredDischarge) -> Iterator[Json]:
    table, alpha = measured.discharge.verticals, measured.job.config.alpha
    columns = (*table.position_m.T, table.chainage_m, table.bed_m, table.depth_m, table.channel, table.count,
               table.measured, table.surface_m_s, table.along_m_s, table.sigma_m_s, alpha * table.surface_m_s,
               table.part_m3_s)
    for values in zip(*(column.tolist() for column in columns), strict=True):
        yield {name: _finite(value) for name, value in zip(_COLUMNS, values, strict=True)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _write_csv(measured: MeasuredDischarge, path: Path) -> None:
    write_table(_COLUMNS, ([_cell(value) for value in row.values()] for row in _rows(measured)), path)


def _cell(value: float | bool | None) -> str:
    return str(int(value)) if isinstance(value, bool | int) else number(value)


def _write_page(measured: MeasuredDischarge, rating: Rating | str | None, tree: Json, folder: Path) -> Path:
    from stab_ros.report.discharge_page import write_discharge  # here, as matplotlib takes a second to import

    return write_discharge(measured.discharge, measured.vectors, rating if isinstance(rating, Rating) else None, tree,
                           folder)
