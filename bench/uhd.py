"""The engine at 4K beside its peers, on the same frames in turn, and how many frames a second it does by itself."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
import peers
from accuracy import written
from effort import Effort
from environment import UnavailableError, running
from lanes import Lane, asked, lanes_data, lanes_table, raced
from packages import STABILO, stabilo
from peers import Peer
from scenes import UHD, Scene, render
from tables import Section, Table, number

from stab_ros.core.settings import Value
from stab_ros.core.types import Frame, Homography
from stab_ros.parameters.engines import make_stabilizer

ENGINE, TRACK, ECC, OTHER = "engine: track and warp", "track alone", "ecc, water masked", "stabilo"
_NOTE = ("kolubara, mono8. ecc is OpenCV's, over four levels, with the water masked out by the truth; the others find "
         "it out. stabilo as it is set by default, ORB at half the size, in colour, and with its warp; the others do "
         "not warp.")


@dataclass(frozen=True)
class Goal:
    """One figure beside its target; `most`: it must not be larger, else not smaller."""

    name: str
    value: float
    target: float
    most: bool = False

    def row(self) -> tuple[str, ...]:
        met = self.value <= self.target if self.most else self.value >= self.target
        bound = f"{'<=' if self.most else '>='} {self.target:g}"
        return self.name, number(self.value, 2), bound, "yes" if met else "NO"


def measure(effort: Effort) -> Section:
    """The race, then the engine alone."""
    scene = render("kolubara", UHD, effort.uhd)
    lanes = _race(scene)
    count = effort.timed[1]
    goals = [*_beside_peers({lane.name.split()[0].strip(":,"): lane for lane in lanes}),
             Goal("mono8 alone, frames/s", _alone_hz(scene, count, "mono8"), 30.0),
             Goal("mono8 alone, one thread, frames/s", _alone_hz(scene, count, "mono8", threads=1), 0.0),
             Goal("bgr8 alone, frames/s", _alone_hz(scene, count, "bgr8"), 15.0)]
    tables = [lanes_table(f"{UHD[0]}x{UHD[1]}, {effort.uhd - 1} frames", ENGINE, lanes, _NOTE),
              Table("Targets", ("", "found", "target", "met"), [goal.row() for goal in goals])]
    return Section("4K", tables, {"lanes": lanes_data(lanes, ENGINE), "goals": {one.name: one.value for one in goals}})


def _beside_peers(lanes: dict[str, Lane]) -> Iterator[Goal]:
    engine, ecc, other = lanes["engine"], lanes["ecc"], lanes["stabilo"]
    if not other.absent:
        yield Goal("stabilo, times as long as the engine", other.times_as_long(engine), 8.0)
    yield Goal("ecc, times as long as the engine", ecc.times_as_long(engine), 40.0)
    yield Goal("error, of that of ecc", engine.error.median / ecc.error.median, 2.0, most=True)
    yield Goal("track alone, ms", lanes["track"].ms.median, 12.0, most=True)


def _race(scene: Scene) -> list[Lane]:
    with _ours(scene) as ours, tempfile.TemporaryDirectory() as folder:
        pictures = Path(folder) / "pictures.npy"
        np.save(pictures, np.stack([frame.image for frame in scene.frames]))
        try:
            with running(STABILO, str(pictures)) as child:
                other = Lane(f"{OTHER} {child.version}", stabilo(child, scene, "with_warp_ms"))
                return raced([*ours, other], len(scene.frames))
        except UnavailableError as why:
            return [*raced(ours, len(scene.frames)), Lane(OTHER, absent=str(why))]


@contextmanager
def _ours(scene: Scene) -> Iterator[list[Lane]]:
    """And what OpenCV has, in this process too."""
    reference = scene.frames[0].image
    others = [Lane(recipe.name, asked(scene, _peer(Peer(recipe, reference), scene)))
              for recipe in (peers.orb_ransac(), peers.sift_magsac())]
    with tempfile.TemporaryDirectory() as folder:
        water = str(written(scene.water, Path(folder) / "water.png"))
        ecc = asked(scene, _tracker(scene, {"method": "ecc", "exclude": water}))
    yield [Lane(ENGINE, asked(scene, _tracker(scene, {}, warp=True))), Lane(TRACK, asked(scene, _tracker(scene, {}))),
           Lane(ECC, ecc), *others]


def _tracker(scene: Scene, values: dict[str, Value], warp: bool = False) -> Callable[[int], Homography | None]:
    stabilizer = make_stabilizer(values)
    stabilizer.track(scene.frames[0])

    def ref_H_cur(index: int) -> Homography | None:
        track = stabilizer.track(scene.frames[index])
        if warp:
            stabilizer.warp(scene.frames[index], track)
        return track.ref_H_cur

    return ref_H_cur


def _peer(peer: Peer, scene: Scene) -> Callable[[int], Homography | None]:
    return lambda index: peer.ref_H_cur(scene.frames[index].image)


def _alone_hz(scene: Scene, count: int, encoding: str, threads: int = 0) -> float:
    """Track and warp of pictures in memory, nothing else in between."""
    images = [frame.image if encoding == "mono8" else cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)
              for frame in scene.frames[:8]]
    stabilizer, turn, start_s = make_stabilizer({"threads": threads}), len(images) - 1, 0.0
    for number_ in range(-4, count):
        if number_ == 0:
            start_s = perf_counter()
        image = images[turn - abs(turn - (number_ + 4) % (2 * turn))]
        frame = Frame(image, encoding, scene.frames[1].stamp_ns * (number_ + 5) // 24)
        stabilizer.warp(frame, stabilizer.track(frame))
    return count / (perf_counter() - start_s)
