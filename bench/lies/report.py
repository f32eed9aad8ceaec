"""What many flights have shown, as lines and a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from lies.draw import KINDS, Recipe
from lies.judge import DOUBTFUL, FAR, GRAVE, LOST, Verdict

Judged = tuple[Recipe, list[Verdict]]  # a flight
_HEAD = ("kind", "flights", "frames", "tracked", "grave", "> 4 sigma", "> 1 px", "LOST", "LOST, seen", "median px",
         "worst px", "error/sigma", "<= 2 sigma")


def line(recipe: Recipe, verdict: Verdict) -> str:
    """One line on a frame."""
    what = f"{verdict.reason}, SIFT {verdict.error_px:.2f} px" if verdict.said == LOST else (
        f"{verdict.error_px:.3f} px off, sigma {verdict.sigma_px:.4f}")
    return (f"{verdict.said:5}  seed {recipe.seed}  frame {verdict.frame:3}  {what}  "
            f"[{recipe.fault}, {recipe.motion}, {recipe.texture}]")


def lines(recipe: Recipe, verdicts: Sequence[Verdict]) -> list[str]:
    """A line on every frame of a flight of which something is to be said."""
    return [line(recipe, verdict) for verdict in verdicts if verdict.said]


def brief(recipe: Recipe, verdicts: Sequence[Verdict]) -> list[str]:
    """One line on a flight, if something is to be said of any frame."""
    said = [verdict.said for verdict in verdicts if verdict.said]
    if not said:
        return []
    counts = ", ".join(f"{said.count(word)} {word}" for word in (GRAVE, DOUBTFUL, FAR, LOST) if word in said)
    worst = max((verdict.error_px for verdict in verdicts if verdict.tracked), default=0.0)
    return [f"seed {recipe.seed}: {counts}; worst {worst:.2f} px: {recipe}"]


def reasons(flights: Sequence[Judged]) -> str:
    """Why frames were LOST, the most frequent reason first."""
    counts = Counter(verdict.reason for _, verdicts in flights for verdict in verdicts if verdict.reason)
    return "LOST: " + (", ".join(f"{n} {reason}" for reason, n in counts.most_common()) or "none")


def table(flights: Sequence[Judged]) -> str:
    """A row for each kind that was drawn, and one for all."""
    rows = [_row("all", flights)]
    for kind in KINDS:
        of_kind = [flight for flight in flights if kind in flight[0].kinds]
        rows += [_row(kind, of_kind)] if of_kind else []
    widths = [max(len(row[k]) for row in (_HEAD, *rows)) for k in range(len(_HEAD))]
    rule = tuple("-" * width for width in widths)
    return "\n".join("| " + " | ".join(cell.ljust(width) if k == 0 else cell.rjust(width) for k, (cell, width)
                                       in enumerate(zip(row, widths, strict=True))) + " |"
                     for row in (_HEAD, rule, *rows))


def _row(kind: str, flights: Sequence[Judged]) -> tuple[str, ...]:
    verdicts = [verdict for _, of_flight in flights for verdict in of_flight]
    counted = [verdict for verdict in verdicts if verdict.counts]
    said = [verdict.said for verdict in verdicts]
    lost = sum(not verdict.tracked and not verdict.garbage for verdict in verdicts)
    over = said.count(GRAVE) + said.count(DOUBTFUL)
    return (kind, f"{len(flights)}", f"{len(verdicts)}", f"{len(counted)}", f"{said.count(GRAVE)}", f"{over}",
            f"{said.count(GRAVE) + said.count(FAR)}", f"{lost}", f"{said.count(LOST)}", *_statistics(counted))


def _statistics(counted: Sequence[Verdict]) -> tuple[str, str, str, str]:
    if not counted:
        return "-", "-", "-", "-"
    error_px = np.array([verdict.error_px for verdict in counted])
    ratio = error_px / np.array([max(verdict.sigma_px, 1e-9) for verdict in counted])
    return (f"{np.median(error_px):.3f}", f"{error_px.max():.2f}", f"{np.median(ratio):.2f}",
            f"{np.mean(ratio <= 2):.1%}")
