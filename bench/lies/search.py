"""The search itself: many flights, a few at a time."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import yaml
from tqdm import tqdm

from lies.draw import KINDS, Recipe, draw
from lies.judge import Verdict, judge
from lies.render import render
from lies.report import Judged, brief, lines, reasons, table
from stab_ros.core.settings import Value

Say = Callable[[Recipe, Sequence[Verdict]], list[str]]  # the lines on a flight


@dataclass(frozen=True)
class Search:
    """Which flights, and which parameters of the tracker differ from their defaults."""

    frames: int
    kind: str
    values: dict[str, Value]

    def fly(self, seed: int) -> Judged:
        """Draws, renders and judges a flight, on one thread."""
        cv2.setNumThreads(1)
        recipe = draw(seed, self.frames, self.kind)
        return recipe, judge(render(recipe), self.values)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the search; the exit code is 1 where a frame was grave."""
    options = _parser().parse_args(arguments)
    search = Search(options.frames, options.kind, dict(options.parameter))
    if options.show is not None:
        return _show(draw(options.show, options.frames, options.kind), options.folder)
    seeds = range(options.first, options.first + options.flights)
    flights = list(_flights(search, seeds, options.jobs, brief if options.brief else lines))
    print(table(flights), reasons(flights), sep="\n\n")
    if options.json:
        options.json.write_text(json.dumps([_data(*flight) for flight in flights]))
    return int(any(verdict.said == "grave" for _, verdicts in flights for verdict in verdicts))


def _flights(search: Search, seeds: Sequence[int], jobs: int, say: Say) -> Iterator[Judged]:
    """Flies in `jobs` processes and prints each lie as soon as its flight's turn has come."""
    os.environ["OMP_NUM_THREADS"] = "1"  # of the processes to come
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for recipe, verdicts in tqdm(pool.map(partial(_fly, search), seeds), "flights", len(seeds), disable=None):
            for text in say(recipe, verdicts):
                tqdm.write(text)
            yield recipe, verdicts


def _fly(search: Search, seed: int) -> Judged:
    return search.fly(seed)


def _show(recipe: Recipe, folder: Path) -> int:
    """Writes the pictures of a flight."""
    print(recipe)
    folder.mkdir(parents=True, exist_ok=True)
    for k, picture in enumerate(render(recipe).pictures):
        cv2.imwrite(str(folder / f"{k:04}.png"), picture)
    print(f"{recipe.frames} pictures in {folder}")
    return 0


def _data(recipe: Recipe, verdicts: Sequence[Verdict]) -> dict[str, object]:
    return {"recipe": asdict(recipe), "verdicts": [asdict(verdict) for verdict in verdicts]}


def _parameter(text: str) -> tuple[str, Value]:
    name, found, value = text.partition(":=")
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME:=VALUE")
    return name, yaml.safe_load(value)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Random flights: what the tracker says, and what is so.")
    parser.add_argument("--flights", type=int, default=100, help="number of flights")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="seed of the first; the next has the next")
    parser.add_argument("--frames", type=int, default=60, help="of a flight, 25 a second")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes")
    parser.add_argument("--kind", choices=KINDS, default="", metavar="KIND",
                        help=f"flights of one kind: {', '.join(KINDS)}")
    parser.add_argument("-p", dest="parameter", type=_parameter, action="append", default=[], metavar="NAME:=VALUE",
                        help="a parameter of the tracker")
    parser.add_argument("--brief", action="store_true", help="one line for each flight, not for each frame")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write recipes and verdicts there")
    parser.add_argument("--show", type=int, metavar="SEED", help="write the pictures of one flight, and judge nothing")
    parser.add_argument("--folder", type=Path, default=Path("lies_output"), help="where --show writes to")
    return parser
