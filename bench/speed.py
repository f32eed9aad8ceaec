"""Time per frame of gray, track and warp, beside OpenCV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle

import cv2
import parts
import peers
from effort import Effort
from peers import Peer, Recipe
from race import Lap, Runner, race
from scenes import HD, UHD, Scene, render
from spread import Spread
from tables import Section, Table, number, verdict

from stab_ros.core.gray import to_gray
from stab_ros.core.types import Frame, Homography, State, Track
from stab_ros.parameters.engines import make_stabilizer

TARGET_MS = {HD: 15.0, UHD: 12.0}  # of the direct method, two cores
WARP_TARGET_MS = 10.0  # and at most half of OpenCV's
TRACK, ALONE, WARP = "track, direct", "track, direct, alone", "warp"
_NOTE = ("Each frame goes through all rows in turn; `alone`: through nothing else. "
         "CPU: median processor time, all cores together. Error: median RMS distance to the truth of the same frames.")
_COLOUR_FRAMES = 4  # in turn, so that none is left in the processor's cache


def measure(effort: Effort) -> Section:
    """Both sizes, one after the other."""
    tables: list[Table] = []
    data: dict[str, object] = {}
    for size, rounds in zip((HD, UHD), effort.timed, strict=True):
        scene = render("kolubara", size, effort.rendered)
        runners = _runners(scene, effort)
        alone = _tracker(ALONE, "direct")
        laps = race(runners, scene, rounds) | race([alone], scene, rounds)
        shares = parts.profile(scene, effort.profiled)
        name = f"{size[0]}x{size[1]}"
        tables.append(_table(name, [alone, *runners], laps, TARGET_MS[size]))
        tables.append(shares.table(f"Where `{TRACK}` spends its time, {name}"))
        data[name] = _data([alone, *runners], laps, TARGET_MS[size]) | {"share_of_track": dict(shares.shares)}
    return Section("Speed", tables, data)


def _runners(scene: Scene, effort: Effort) -> list[Runner]:
    reference = scene.frames[0].image
    return [
        _gray("gray from mono8", scene.frames[:_COLOUR_FRAMES]),
        _gray("gray from bgr8", [_colour(frame) for frame in scene.frames[:_COLOUR_FRAMES]]),
        _tracker(TRACK, "direct"),
        _tracker("track, klt", "klt"),
        *(_peer(recipe, Peer(recipe, reference), effort.peer_every)
          for recipe in (peers.orb_ransac(), peers.sift_magsac())),
        _warp(),
        Runner("cv2.warpPerspective", _cv2_warp, beside=WARP),
    ]


def _colour(frame: Frame) -> Frame:
    return Frame(cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR), "bgr8", frame.stamp_ns)


def _gray(name: str, frames: Sequence[Frame]) -> Runner:
    """The frames in turn, whatever the race's is."""
    turn = cycle(frames)

    def run(_frame: Frame, _truth: Homography) -> None:
        to_gray(next(turn))

    return Runner(name, run)


def _tracker(name: str, method: str) -> Runner:
    stabilizer = make_stabilizer({"method": method})
    return Runner(name, lambda frame, _: stabilizer.track(frame).ref_H_cur, tracks=True,
                  beside="" if method == "direct" else TRACK)


def _peer(recipe: Recipe, peer: Peer, every: int) -> Runner:
    return Runner(recipe.name, lambda frame, _: peer.ref_H_cur(frame.image), every, tracks=True, beside=TRACK)


def _warp() -> Runner:
    stabilizer = make_stabilizer({})

    def run(frame: Frame, truth: Homography) -> None:
        stabilizer.warp(frame, Track(State.TRACKED, 0, frame.stamp_ns, 0, 0, ref_H_cur=truth))

    return Runner(WARP, run)


def _cv2_warp(frame: Frame, truth: Homography) -> None:
    cv2.warpPerspective(frame.image, truth, frame.size, flags=cv2.INTER_LINEAR)


def _table(size: str, runners: Sequence[Runner], laps: Mapping[str, Lap], target_ms: float) -> Table:
    head = ("ms per frame", "5 %", "median", "95 %", "target", "met", "CPU", "frames", "times", "as long as",
            "error, px", "lost")
    targets_ms = {TRACK: target_ms, ALONE: target_ms, WARP: WARP_TARGET_MS}
    rows = [_row(runner, laps, targets_ms.get(runner.name)) for runner in runners]
    return Table(f"{size} mono8, kolubara", head, rows, _NOTE)


def _row(runner: Runner, laps: Mapping[str, Lap], target_ms: float | None) -> tuple[str, ...]:
    lap = laps[runner.name]
    times = lap.times()
    ratio = number(lap.ratio(laps[runner.beside]), 2) if runner.beside else ""
    error = (number(Spread.of(lap.error_px).median, 3), str(lap.lost)) if runner.tracks else ("", "")
    spread = (number(times.p5, 2), number(times.median, 2), number(times.p95, 2))
    return (runner.name, *spread, *verdict(times.median, target_ms), number(Spread.of(lap.cpu_ms).median, 2),
            str(times.count), ratio, runner.beside, *error)


def _data(runners: Sequence[Runner], laps: Mapping[str, Lap], target_ms: float) -> dict[str, object]:
    told: dict[str, object] = {"target_track_direct_ms": target_ms}
    for runner in runners:
        lap = laps[runner.name]
        told[runner.name] = {
            "ms": lap.times().data(),
            "cpu_ms": Spread.of(lap.cpu_ms).data(),
            **({"error_px": Spread.of(lap.error_px).data(), "lost": lap.lost} if runner.tracks else {}),
            **({"times_as_long": lap.ratio(laps[runner.beside]), "as": runner.beside} if runner.beside else {}),
        }
    return told
