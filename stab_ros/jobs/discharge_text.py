"""The tables that `stab-ros discharge` prints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stab_ros.core.text import counted
from stab_ros.discharge.rating import Rating
from stab_ros.discharge.result import Discharge
from stab_ros.jobs.discharge import MeasuredDischarge


def as_text(measured: MeasuredDischarge) -> str:
    """A row for each wet vertical, then the discharge with its interval, its shares and where its error is from."""
    found, config = measured.discharge, measured.job.config
    return "\n\n".join([_verticals(found, config.alpha), "\n".join(
        [_headline(found), _shares(found), _sources(found), _estimators(found), _geometry(measured)])])


def _verticals(found: Discharge, alpha: float) -> str:
    rows = [["chainage m", "depth m", "vectors", "surface m/s", "sigma m/s", "mean m/s", "part m3/s", "share", ""]]
    table = found.verticals
    for i in np.flatnonzero(table.wet):
        rows.append([
            f"{table.chainage_m[i]:.2f}", f"{table.depth_m[i]:.3f}", str(table.count[i]), f"{table.surface_m_s[i]:.3f}",
            _cell(table.sigma_m_s[i], 3), f"{alpha * table.surface_m_s[i]:.3f}", f"{table.part_m3_s[i]:.4g}",
            f"{table.part_m3_s[i] / found.q_m3_s:.1%}" if found.q_m3_s else "-",
            "" if table.measured[i] else "filled"])
    return _table(rows)


def _headline(found: Discharge) -> str:
    return (f"discharge {found.q_m3_s:.4g} m3/s, with 95 % between {found.low_m3_s:.4g} and {found.high_m3_s:.4g} "
            f"(sigma {found.sigma_m3_s:.2g} m3/s, {_percent(found.sigma_m3_s, found.q_m3_s)})")


def _shares(found: Discharge) -> str:
    shares, table = found.shares, found.verticals
    return (f"measured {shares.measured:.1%}, interpolated {shares.interpolated:.1%}, extrapolated "
            f"{shares.extrapolated:.1%} of it; vectors over {found.measured_width_share:.1%} of the width, at "
            f"{int(table.measured.sum())} of {counted(int(table.wet.sum()), 'vertical')}, {found.vectors} within "
            f"{found.search_m:.3g} m")


def _sources(found: Discharge) -> str:
    parts = [f"{name} {_percent(sigma, found.q_m3_s)}" for name, sigma in found.sources_m3_s.items()]
    return f"sigma by source: {', '.join(parts)}"


def _estimators(found: Discharge) -> str:
    told = {"ISO 748": found.iso_sigma, "interpolated variance estimator": found.ive_sigma}
    return "beside it: " + ", ".join(f"{name} {_percent(value, 1.0)}" for name, value in told.items())


def _geometry(measured: MeasuredDischarge) -> str:
    found, config = measured.discharge, measured.job.config
    return (f"area {found.area_m2:.4g} m2, width {found.width_m:.4g} m, mean velocity {found.mean_m_s:.3g} m/s, water "
            f"surface {found.wse_m:.6g} m ({measured.level}); alpha {config.alpha:g} +- {config.alpha_sigma:g}, "
            f"{config.integration}, filling {config.filling}")


def rating_text(rating: Rating | str) -> str:
    """The curve, or why there is none."""
    if isinstance(rating, str):
        return f"rating curve: none yet: {rating}"
    sigma = np.sqrt(np.diag(rating.covariance))
    rows = [["stage m", "m3/s", "curve m3/s", "sigma", "off"]]
    stages = np.array([one.stage_m for one in rating.gaugings])
    for one, q, relative in zip(rating.gaugings, *rating.at(stages), strict=True):
        rows.append([f"{one.stage_m:.3f}", f"{one.q_m3_s:.4g}", f"{q:.4g}", f"{relative:.1%}",
                     f"{one.q_m3_s / q - 1:+.1%}"])
    return (f"{_table(rows)}\n\nrating curve Q = {rating.a:.4g} (h - {rating.h0_m:.4g})^{rating.b:.4g}; sigma of ln a "
            f"{sigma[0]:.2g}, of b {sigma[1]:.2g}, of h0 {sigma[2]:.2g} m; gaugings share up to "
            f"{max(one.shared_sigma for one in rating.gaugings):.1%}")


def _percent(part: float, whole: float) -> str:
    return f"{abs(part / whole):.1%}" if whole and np.isfinite(part) else "-"


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
                     for row in rows)
