"""Error against the exact truth of synthetic flights: RMS distance over the contract's 9x9 grid."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import peers
from effort import Effort
from peers import Peer
from scenes import HD, Scene, render
from spread import Spread
from tables import Section, Table, number, verdict
from tqdm import tqdm

from stab_ros.core.geometry import rms_distance
from stab_ros.core.settings import Value
from stab_ros.core.types import BoolArray, Frame, Homography
from stab_ros.parameters.engines import make_stabilizer

PRESETS = ("kolubara", "alpine")
DIRECT, EXCLUDE, KLT = "direct", "direct, water excluded", "klt"
TARGETS_PX: Mapping[str, tuple[float, float | None]] = {  # median, 95 %
    DIRECT: (0.02, 0.1), EXCLUDE: (0.012, 0.02), KLT: (0.15, None),
}
_PEER_EVERY = 4

Register = Callable[[Frame], Homography | None]
Errors = list[float | None]


def measure(effort: Effort) -> Section:
    """Every preset with every setting."""
    tables, data = [], {}
    for name in PRESETS:
        errors = _of_preset(render(name, HD, effort.flight))
        tables.append(_table(name, effort.flight, errors))
        data[name] = {who: {"error_px": Spread.of(_known(found)).data(), "lost": found.count(None)}
                      for who, found in errors.items()}
    targets = {who: {"median": median, "p95": p95} for who, (median, p95) in TARGETS_PX.items()}
    return Section("Error against truth", tables, data | {"targets_px": targets})


def _of_preset(scene: Scene) -> dict[str, Errors]:
    """Errors in px by setting."""
    with tempfile.TemporaryDirectory() as folder:
        mask = written(scene.water, Path(folder) / "water.png")
        settings: dict[str, dict[str, Value]] = {DIRECT: {}, EXCLUDE: {"exclude": str(mask)}, KLT: {"method": "klt"}}
        errors = {name: _errors(name, _engine(values, scene), scene, 1) for name, values in settings.items()}
    for recipe in (peers.orb_ransac(), peers.sift_magsac()):
        errors[recipe.name] = _errors(recipe.name, _peer(Peer(recipe, scene.frames[0].image)), scene, _PEER_EVERY)
    return errors


def written(mask: BoolArray, path: Path) -> Path:
    """The mask as a PNG."""
    cv2.imwrite(str(path), mask.astype(np.uint8) * 255)
    return path


def _engine(values: Mapping[str, Value], scene: Scene) -> Register:
    """As the command answers, the start included."""
    stabilizer = make_stabilizer(values)
    tracks = [track for frame in scene.frames for track in stabilizer.answers(frame)] + stabilizer.finish()
    found = {track.stamp_ns: track.ref_H_cur for track in tracks}
    return lambda frame: found[frame.stamp_ns]


def _peer(peer: Peer) -> Register:
    return lambda frame: peer.ref_H_cur(frame.image)


def _errors(name: str, register: Register, scene: Scene, every: int) -> Errors:
    """Of every n-th frame but the reference; None where it was lost."""
    errors: Errors = []
    for index in tqdm(range(0, len(scene.frames), every), name, disable=None, leave=False):
        found = register(scene.frames[index])
        errors.append(None if found is None else rms_distance(found, scene.truth[index], scene.size))
    return errors[1:]


def _known(errors: Errors) -> list[float]:
    return [error for error in errors if error is not None]


def _table(preset: str, frames: int, errors: Mapping[str, Errors]) -> Table:
    head = ("error, px", "median", "target", "met", "95 %", "target", "met", "max", "frames", "lost")
    return Table(f"{preset}, {frames} frames of {HD[0]}x{HD[1]}", head, [_row(*item) for item in errors.items()])


def _row(name: str, errors: Errors) -> tuple[str, ...]:
    spread, targets_px = Spread.of(_known(errors)), TARGETS_PX.get(name, (None, None))
    return (name, number(spread.median, 4), *verdict(spread.median, targets_px[0]), number(spread.p95, 4),
            *verdict(spread.p95, targets_px[1]), number(spread.max, 4), str(len(errors)),
            str(errors.count(None)))
