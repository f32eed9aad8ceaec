"""Our methods beside OpenPIV and pyorc on the same frames of rivers whose velocity is known everywhere.

    PYTHONPATH=.:bench .venv/bin/python bench/velocimetry/peers_velocity.py --home /tmp/velocity_peers

Each peer is installed from PyPI into an environment of its own below HOME, unless it is there, and runs as a process
that gets PNG files and writes a CSV; so do we. All have one thread, and their processor time is taken in turn.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from effort import FULL, Effort
from environment import FOLDER, Child, Package, UnavailableError, running
from peers_river import CELL_PX, SCENES, SHORE_PX, Judged, River, Scene
from peers_settings import CHOSEN, WAYS, Settings, Way
from tables import Section, Table, number

_HERE = Path(__file__).resolve().parent
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_SWEPT_SEED, _FIRST_SEED = 101, 1
_LEAST_COVERED, _MOST_OUTLIERS = 75.0, 5.0  # percent, of settings that may be chosen
_HEAD = ("method", "settings", "vectors", "covered, %", "median error, mm/s", "95 %", "bias, mm/s", "outliers, %",
         "CPU ms a frame", "times particles", "times lspiv")
_NOTE = (f"Vectors at least {SHORE_PX:g} px off the shore; they cover places on the water within {CELL_PX} px. Bias: "
         "mean signed error along the flow without outliers, which err by more than a fifth of the mean speed. CPU: "
         "one thread, frames in memory, divided by the frames of the video.")


class _Ours(Package):
    """Runs in this environment."""

    def python(self) -> Path:
        return Path(sys.executable)


@dataclass(frozen=True)
class Lane:
    """A row of a table. label: which settings."""

    way: Way
    label: str
    settings: Settings

    @staticmethod
    def of(scene: Scene) -> list[Lane]:
        found = []
        for way in WAYS:
            found.append(Lane(way, "usual", way.usual))
            chosen = CHOSEN.get(scene.name, {}).get(way.name)
            if chosen is not None and chosen != way.usual:
                found.append(Lane(way, "swept", chosen))
        return found


@dataclass(frozen=True, eq=False)
class Outcome:
    """Of a lane. cpu_ms: of a frame, by round."""

    lane: Lane
    version: str
    judged: Judged
    cpu_ms: Sequence[float]


def packages(home: Path) -> Mapping[str, Package]:
    """By the names that ways have for them."""
    return {"ours": _Ours("stab_ros", _HERE / "peers_of_ours.py"),
            "openpiv": Package("openpiv", _HERE / "peers_of_openpiv.py", ("OpenPIV>=0.26",), home),
            "pyorc": Package("pyopenrivercam", _HERE / "peers_of_pyorc.py", ("pyopenrivercam>=0.9.10",), home)}


def measure(effort: Effort, home: Path = FOLDER, scenes: Sequence[Scene] = SCENES) -> Section:
    """A table for each river."""
    most, seeds, rounds = effort.rivers
    with _processes(home) as (children, missing), tempfile.TemporaryDirectory() as folder:
        tables, data = [], dict[str, object]()
        for scene in scenes[:most]:
            rivers = [River(scene, _FIRST_SEED + k, Path(folder) / scene.name / str(k)) for k in range(seeds)]
            outcomes = _raced(children, scene, rivers, rounds)
            tables.append(_table(scene, rivers[0], outcomes, missing))
            data[scene.name] = [_data(outcome, outcomes) for outcome in outcomes]
    return Section("Velocities beside packages of PyPI", tables, {"rivers": data, "missing": missing})


@contextmanager
def _processes(home: Path) -> Iterator[tuple[Mapping[str, Child], Sequence[str]]]:
    """Those that run, and a line for each that cannot be had."""
    children, missing = dict[str, Child](), list[str]()
    with ExitStack() as stack:
        for name, package in packages(home).items():
            try:
                with _one_thread():
                    children[name] = stack.enter_context(running(package))
            except UnavailableError as why:
                missing.append(f"{name} is missing ({why}): with access to PyPI this command installs "
                               f"{package.requirements[0]} into {package.home / package.name}.")
        yield children, missing


@contextmanager
def _one_thread() -> Iterator[None]:
    """For processes that start meanwhile."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _raced(children: Mapping[str, Child], scene: Scene, rivers: Sequence[River], rounds: int) -> list[Outcome]:
    """Vectors of all rivers, then times of the first one, lane by lane in each round."""
    lanes = [lane for lane in Lane.of(scene) if lane.way.package in children]
    judged = [_judged(children[lane.way.package], lane.settings, rivers) for lane in lanes]
    times = [[_cpu_ms(children[lane.way.package], lane.settings, rivers[0]) for lane in lanes] for _ in range(rounds)]
    return [Outcome(lane, children[lane.way.package].version, found, cpu_ms)
            for lane, found, cpu_ms in zip(lanes, judged, zip(*times, strict=True), strict=True)]


def _judged(child: Child, settings: Settings, rivers: Sequence[River]) -> Judged:
    found = []
    for river in rivers:
        child.ask(river.question(settings))
        found.append(river.judged())
    return Judged.of_all(found)


def _cpu_ms(child: Child, settings: Settings, river: River) -> float:
    return 1e3 * float(child.ask(river.question(settings))["cpu_s"]) / river.count


def _table(scene: Scene, river: River, outcomes: Sequence[Outcome], missing: Sequence[str]) -> Table:
    flight = river.flight
    title = (f"{scene.name}: {flight.size[0]}x{flight.size[1]}, {1e3 * flight.gsd_m:.1f} mm/px, {river.count} frames, "
             f"mean speed {outcomes[0].judged.mean_mm_s:.0f} mm/s")
    return Table(title, _HEAD, [_row(outcome, outcomes) for outcome in outcomes], "\n".join([_NOTE, *missing]))


def _row(outcome: Outcome, outcomes: Sequence[Outcome]) -> list[str]:
    found, lane = outcome.judged.figures(), outcome.lane
    name = lane.way.name if lane.way.package == "ours" else outcome.version
    return [name, f"{lane.label}: {_told(lane.settings)}", str(found["vectors"]), number(found["covered"], 0),
            number(found["median_mm_s"], 2), number(found["p95_mm_s"], 1), _signed(found["bias_mm_s"]),
            number(found["outliers"], 1), number(float(np.median(outcome.cpu_ms)), 1),
            *(number(_times(outcome, outcomes, way), 2) for way in ("particles", "lspiv"))]


def _signed(value: float) -> str:
    return f"{value:+.2f}" if np.isfinite(value) else "-"


def _told(settings: Settings) -> str:
    told = [f"{name} {'+'.join(map(str, value)) if isinstance(value, list) else value}"
            for name, value in settings.items() if name not in ("method", "edges", "slowest_m_s") or value is True]
    return ", ".join(told) or "default"


def _times(outcome: Outcome, outcomes: Sequence[Outcome], way: str) -> float:
    """Median over the rounds of the ratio to ours with the usual settings, in the same round."""
    ours = next(one for one in outcomes if one.lane.way.name == way and one.lane.label == "usual")
    return float(np.median(np.array(outcome.cpu_ms) / np.array(ours.cpu_ms)))


def _data(outcome: Outcome, outcomes: Sequence[Outcome]) -> dict[str, object]:
    return {"method": outcome.lane.way.name, "version": outcome.version, "settings": dict(outcome.lane.settings),
            **outcome.judged.figures(), "cpu_ms": list(outcome.cpu_ms),
            "times_particles": _times(outcome, outcomes, "particles")}


def sweep(home: Path, scenes: Sequence[Scene]) -> None:
    """Prints the best settings of each way, by the median error of those that cover most and have few outliers."""
    with _processes(home) as (children, missing), tempfile.TemporaryDirectory() as folder:
        print(*missing, sep="\n", file=sys.stderr)
        for scene in scenes:
            river = River(scene, _SWEPT_SEED, Path(folder) / scene.name)
            for way in WAYS:
                if way.swept and way.package in children:
                    tried = [(_figures(children[way.package], one, river), one) for one in (way.usual, *way.swept)]
                    print(scene.name, way.name, *min(tried, key=lambda one: _merit(one[0])), sep=" | ", flush=True)


def _figures(child: Child, settings: Settings, river: River) -> Mapping[str, float]:
    return {name: round(value, 2) for name, value in _judged(child, settings, [river]).figures().items()}


def _merit(figures: Mapping[str, float]) -> tuple[bool, float]:
    """The smaller, the better."""
    usable = figures["covered"] >= _LEAST_COVERED and figures["outliers"] <= _MOST_OUTLIERS
    return not usable, figures["median_mm_s"] if np.isfinite(figures["median_mm_s"]) else np.inf


def main() -> None:
    """Prints the tables, or what the sweep chooses."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--home", type=Path, default=FOLDER, help="folder of the peers' environments")
    parser.add_argument("--scene", action="append", choices=[scene.name for scene in SCENES], help="these rivers alone")
    parser.add_argument("--rounds", type=int, default=FULL.rivers[2], help="of times, of which the median counts")
    parser.add_argument("--sweep", action="store_true", help="choose settings anew, on another seed")
    options = parser.parse_args()
    scenes = [scene for scene in SCENES if options.scene is None or scene.name in options.scene]
    if options.sweep:
        sweep(options.home, scenes)
    else:
        effort = replace(FULL, rivers=(*FULL.rivers[:2], options.rounds))
        print(measure(effort, options.home, scenes).text())


if __name__ == "__main__":
    main()
