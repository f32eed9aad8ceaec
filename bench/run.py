"""Measures speed, error and memory: `python bench/run.py [--quick] [--only NAME] [--json FILE]`.

The report is Markdown, to read on a terminal or to keep. Nothing here passes or fails: targets stand beside results.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import accuracy
import delivery
import evaluation
import faults
import live
import machine
import memory
import methods
import offline
import packages
import real_video
import relief
import speed
import static_ground
import uhd
import uncertainty
from effort import FULL, QUICK, Effort
from environment import FOLDER
from tables import Section

from stab_ros.core.memory import keep_freed_memory

sys.path.append(str(Path(__file__).resolve().with_name("velocimetry")))

import peers_velocity

SECTIONS: Mapping[str, Callable[[Effort], Section]] = {
    "speed": speed.measure,
    "accuracy": accuracy.measure,
    "uhd": uhd.measure,
    "methods": methods.measure,
    "packages": packages.measure,
    "velocities": peers_velocity.measure,
    "evaluation": evaluation.measure,
    "static_ground": static_ground.measure,
    "faults": faults.measure,
    "uncertainty": uncertainty.measure,
    "relief": relief.measure,
    "memory": memory.measure,
    "delivery": delivery.measure,
    "live": live.measure,
    "offline": offline.measure,
    "real_video": real_video.measure,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints each part as soon as it is done."""
    options = _parser().parse_args(arguments)
    machine.use_two_cores()
    keep_freed_memory()  # as nodes and command do; OpenCV's ways gain by it as well
    facts = machine.describe()
    print(_head(facts, options.quick), flush=True)
    results: dict[str, object] = {"machine": facts, "quick": options.quick}
    sections: dict[str, Callable[[Effort], Section]] = {**SECTIONS}
    sections["velocities"] = partial(peers_velocity.measure, home=options.peers)
    for name in options.only or sections:
        section = sections[name](QUICK if options.quick else FULL)
        print(f"\n{section.text()}", flush=True)
        results[name] = section.data
    if options.json is not None:
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Measures speed, error and memory beside OpenCV and the targets.")
    parser.add_argument("--quick", action="store_true", help="a few frames only: to see that it runs, not to quote")
    parser.add_argument("--only", action="append", choices=tuple(SECTIONS), help="this part alone (may be repeated)")
    parser.add_argument("--peers", type=Path, metavar="FOLDER", default=FOLDER,
                        help="of the environments of what velocities are compared with (%(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where to write all figures as JSON")
    return parser


def _head(facts: Mapping[str, object], quick: bool) -> str:
    title = "# Benchmark" + (", quick: not to be quoted" if quick else "")
    return "\n".join([title, "", *(f"- {name}: {_flat(fact)}" for name, fact in facts.items())])


def _flat(fact: object) -> str:
    if isinstance(fact, Mapping):
        return ", ".join(f"{value} {name}" for name, value in fact.items())
    return " ".join(map(str, fact)) if isinstance(fact, list) else str(fact)


if __name__ == "__main__":
    main()
