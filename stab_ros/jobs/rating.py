"""The rating curve that a discharge joins: which gauging it is, and which one of the table it replaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.discharge.rating import Gauging, Rating, fit_rating
from stab_ros.jobs.discharge import MeasuredDischarge
from stab_ros.velocimetry.digest import digest


@dataclass(frozen=True)
class JoinedGaugings:
    """A table of gaugings with a new one.

    Attributes:
        gaugings: the table.
        replaced: what the new one replaced, one line each.
        doubts: what may be the same recording as the new one, and was kept, one line each.
    """

    gaugings: tuple[Gauging, ...]
    replaced: tuple[str, ...]
    doubts: tuple[str, ...]


def gauging_of(measured: MeasuredDischarge, stage_m: float | None) -> Gauging:
    """The discharge as a gauging of a rating curve. stage_m: None: the water surface elevation.

    What it has by itself is all but alpha, added as standard deviations of the same draws: the difference of whole and
    shared part would be that of two almost equal numbers, one of them drawn.

    Raises:
        InputError: there is neither a stage nor a water surface elevation, or the discharge is not above 0.
    """
    if stage_m is None and not measured.stage_known:
        raise InputError("a rating curve needs the stage; give --stage or --wse")
    found, config = measured.discharge, measured.job.config
    own = float(np.sqrt(sum(sigma**2 for name, sigma in found.sources_m3_s.items() if name != "alpha")))
    return Gauging(found.wse_m if stage_m is None else stage_m, found.q_m3_s, found.sigma_m3_s,
                   config.alpha_sigma / config.alpha, str(measured.job.velocity.resolve()),
                   abs(own / found.q_m3_s) if found.q_m3_s else None, digest(measured.vectors))


def joined_by(known: Sequence[Gauging], new: Gauging) -> JoinedGaugings:
    """The gaugings with a new one. It replaces those of the same velocities, wherever their file lay, and no others."""
    same = [one for one in known if one.recording == new.recording]
    kept = [one for one in known if one.recording != new.recording]
    doubted = [one for one in kept if one.source and Path(one.source).resolve() == Path(new.source)]
    return JoinedGaugings(
        (*kept, new),
        tuple(f"the gauging of the same velocities, {_told(one)}, is replaced" for one in same),
        tuple(f"has another gauging of {one.source}, {_told(one)}, not of the same velocities; both count. Where it is "
              "the same recording, delete its row" for one in doubted))


def _told(one: Gauging) -> str:
    return f"{one.q_m3_s:.4g} m3/s at {one.stage_m:.6g} m"


def rating_of(gaugings: tuple[Gauging, ...], h0_m: float | None) -> Rating | str:
    """The rating curve, or why there is none yet."""
    try:
        return fit_rating(gaugings, h0_m)
    except InputError as error:
        return str(error)
