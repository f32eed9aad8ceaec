"""Whether `sigma_px` holds by kinds of sequence: renderer, photographs, another renderer, and real videos.

    python bench/error_bars.py [--videos FOLDER] [--only WORD] [--half chosen|kept] [--json FILE]

With exact truth: error over sigma. Real videos have none: there SIFT + MAGSAC++ at full size stands in, whose own error
is told by leaving out parts of the picture, and two disjoint halves of the patches are compared. A camera that stands
still (names that begin with `fixed`) has one: no motion. What had to be chosen was chosen on every other sequence of a
kind (`chosen`); the table to quote is that of the others (`kept`).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import photographs
import uncertainty
from peers import Peer, sift_magsac
from photographs import PhotoFlight
from tables import Table, number
from tqdm import tqdm

from stab_ros.core.geometry import apply, grid, rms_distance
from stab_ros.core.gray import to_gray
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Frame, Gray, Homography, Track
from stab_ros.io.homographies import read_homographies
from stab_ros.io.image_folder import ImageFolder
from stab_ros.io.video import VideoFile
from stab_ros.parameters.engines import make_stabilizer

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
_FPS, _GUSTS_FPS = 25.0, 24.0
_SIFT_EVERY = 3
_SIFT_INLIERS = 40  # with fewer it is no judge
_SIFT_AGREEING = 0.5  # of its matches; where fewer do, the scene is no plane, and there is no truth to compare with
_SIFT_CELLS = 4  # per axis


@dataclass(frozen=True)
class TrueSequence:
    """Frames with exact homographies. kept: whether no constant may be chosen on it."""

    name: str
    kind: str
    kept: bool
    frames: Callable[[], Iterable[Frame]]
    truth: Callable[[int], Homography]
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class RealSequence:
    """Frames alone."""

    name: str
    kept: bool
    frames: Callable[[], Iterable[Frame]]
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Verdicts:
    """Of one sequence: what was found off, px, what that should be, px, and how many frames had no answer."""

    name: str
    kind: str
    kept: bool
    off_px: FloatArray
    sigma_px: FloatArray
    lost: int = 0

    @property
    def ratio(self) -> FloatArray:
        return np.asarray(self.off_px / self.sigma_px)

    def row(self) -> tuple[str, ...]:
        if not len(self.off_px):
            return (self.kind, self.name, "-", "-", "-", "-", "0", str(self.lost))
        return (self.kind, self.name, number(float(np.median(self.off_px)), 4),
                number(float(np.median(self.sigma_px)), 4), number(float(np.median(self.ratio)), 2),
                number(100 * float(np.mean(self.ratio <= 2)), 0), str(len(self.off_px)), str(self.lost))


def rendered(frames: int) -> Iterator[TrueSequence]:
    """Those of bench/uncertainty.py, by what is done to them."""
    counts: dict[str, int] = {}
    for one in uncertainty.SEQUENCES:
        if one.still and not (uncertainty.STILLS / one.still).exists():
            continue
        flight = uncertainty.flight_of(one, frames)
        yield TrueSequence(one.name, f"renderer, {one.kind}", _kept(counts, one.kind),
                           partial(uncertainty.frames_of, one, flight), flight.ref_H_cur,
                           {**one.values, **uncertainty.area_of(one)})


def _kept(counts: dict[str, int], kind: str) -> bool:
    """Every other one of a kind."""
    counts[kind] = counts.get(kind, 0) + 1
    return counts[kind] % 2 == 0


_PHOTO_KINDS: Mapping[str, Sequence[tuple[str, Mapping[str, Any]]]] = {
    "usual": (("noise 2", {}), ("noise 6", {"noise": 6.0}), ("lens 0.8 px", {"spoil": photographs.slightly_softened,
                                                                            "both": True})),
    "fog and compression": (("fog", {"spoil": photographs.fogged}), ("JPEG 85", {"quality": 85}),
                            ("JPEG 50", {"quality": 50}), ("MPEG-4", {"video": True})),
    "blurred frames": (("soft", {"spoil": photographs.softened}), ("motion blur 9 px", {"spoil": photographs.dragged})),
    "small or without noise": (("noise 0", {"noise": 0.0}), ("480x270", {"size": (480, 270)})),
    "few patches": (("100 patches", {}),),
    "swinging rows": (("rows 0.5 px", {"spoil": photographs.swung, "both": True}),),
}


def photographed(frames: int) -> Iterator[TrueSequence]:
    """Warped photographs; for each disturbance one half of the photographs is kept."""
    for kind, ways in _PHOTO_KINDS.items():
        for way, (what, changes) in enumerate(ways):
            for number_, path in enumerate(sorted((DATA / "stills").iterdir())):
                for seed in (1, 2):
                    flight = replace(PhotoFlight(path, frames=frames, seed=10 * seed + number_), **changes)
                    yield TrueSequence(f"{path.stem}, {what}, {seed}", f"photographs, {kind}",
                                       (number_ + seed + way) % 2 == 1, partial(_grays, flight.pictures),
                                       flight.ref_H_cur,
                                       {"direct.patches": 100} if kind == "few patches" else {})


def _grays(pictures: Callable[[], Iterable[Gray]]) -> Iterator[Frame]:
    for number_, picture in enumerate(pictures()):
        yield Frame(picture, "mono8", 1_000_000_000 + round(number_ * 1e9 / _FPS))


def gusty() -> Iterator[TrueSequence]:
    """Of another renderer."""
    folder = DATA / "gusts"
    if folder.is_dir():
        rows = read_homographies(folder / "truth.csv")
        truth = {row.frame: row.ref_H_cur for row in rows if row.ref_H_cur is not None}
        yield TrueSequence("gusts", "another renderer", True, partial(_of_folder, folder / "frames", None, _GUSTS_FPS),
                           truth.__getitem__)


def filmed(folder: Path | None, frames: int) -> Iterator[RealSequence]:
    """The recordings beside the project, and whatever videos and folders of pictures there are in `folder`."""
    own = [DATA / "navizence.mp4", *sorted((DATA / "clips").glob("*"))]
    paths = [*own, *(sorted(folder.iterdir()) if folder else [])]
    moving = [path for path in paths if not path.name.startswith("fixed")]
    for number_, path in enumerate(moving):
        yield RealSequence(path.stem, number_ % 2 == 1, partial(_of_path, path, frames))


def standing(folder: Path | None, frames: int) -> Iterator[TrueSequence]:
    """The videos of `folder` whose camera stood still."""
    for number_, path in enumerate(sorted(folder.glob("fixed*")) if folder else []):
        yield TrueSequence(path.stem, "real, fixed camera", number_ % 2 == 1, partial(_of_path, path, frames),
                           lambda _index: np.eye(3))


def _of_path(path: Path, limit: int | None) -> Iterator[Frame]:
    inside = sorted(path.glob("*.mp4")) if path.is_dir() else [path]
    return _of_video(inside[0], limit) if inside else _of_folder(path, limit)


def _of_video(path: Path, limit: int | None) -> Iterator[Frame]:
    with closing(VideoFile(path, None)) as video:
        yield from (frame for _, frame in islice(video.frames(), limit) if isinstance(frame, Frame))


def _of_folder(path: Path, limit: int | None, fps: float = _FPS) -> Iterator[Frame]:
    with closing(ImageFolder(path, fps)) as folder:
        yield from (frame for _, frame in islice(folder.frames(), limit) if isinstance(frame, Frame))


def followed(frames: Iterable[Frame], values: Mapping[str, Value]) -> list[Track]:
    """As the command answers; the start follows all patches, so that halves differ after it."""
    stabilizer = make_stabilizer(values)
    return [track for frame in frames for track in stabilizer.answers(frame)] + stabilizer.finish()


def against_truth(one: TrueSequence) -> Verdicts:
    """Error and sigma of every tracked frame but the reference."""
    frames = list(one.frames())
    off, sigma, tracks = [], [], followed(frames, one.values)
    for track in tracks:
        if track.ref_H_cur is not None and track.sigma_px:
            reference = next(k for k, frame in enumerate(frames) if frame.stamp_ns == track.reference_stamp_ns)
            true = np.linalg.inv(one.truth(reference)) @ one.truth(track.index)
            off.append(rms_distance(track.ref_H_cur, true / true[2, 2], frames[0].size))
            sigma.append(track.sigma_px)
    return Verdicts(one.name, one.kind, one.kept, np.array(off), np.array(sigma), _lost(tracks))


def _lost(tracks: Sequence[Track]) -> int:
    return sum(not track.tracked for track in tracks)


def on_film(one: RealSequence) -> tuple[Verdicts, Verdicts]:
    """Against SIFT, and one half of the patches against the other."""
    frames = list(one.frames())
    tracks = followed(frames, one.values)
    halves = [followed(frames, {**one.values, "direct.subset": half}) for half in ("even", "odd")]
    return _against_sift(one, frames, tracks), _against_each_other(one, frames, *halves)


def _against_each_other(one: RealSequence, frames: Sequence[Frame], even: Sequence[Track],
                        odd: Sequence[Track]) -> Verdicts:
    off, sigma = [], []
    for a, b in zip(even, odd, strict=True):
        same = a.reference_stamp_ns == b.reference_stamp_ns and a.reset_counter == b.reset_counter
        if a.ref_H_cur is None or b.ref_H_cur is None or not (same and a.sigma_px and b.sigma_px):
            continue
        if np.any(a.ref_H_cur != b.ref_H_cur):
            off.append(rms_distance(a.ref_H_cur, b.ref_H_cur, frames[0].size))
            sigma.append(float(np.hypot(a.sigma_px, b.sigma_px)))
    return Verdicts(one.name, "real, halves", one.kept, np.array(off), np.array(sigma), _lost(even) + _lost(odd))


def _against_sift(one: RealSequence, frames: Sequence[Frame], tracks: Sequence[Track]) -> Verdicts:
    off, sigma, judges = [], [], {}
    for track in tracks[::_SIFT_EVERY]:
        if track.ref_H_cur is None or not track.sigma_px:
            continue
        if track.reference_stamp_ns not in judges:
            reference = next(frame for frame in frames if frame.stamp_ns == track.reference_stamp_ns)
            judges[track.reference_stamp_ns] = Peer(sift_magsac(), to_gray(reference))
        found = by_sift(judges[track.reference_stamp_ns], frames[track.index])
        if found is not None:
            off.append(rms_distance(track.ref_H_cur, found[0], frames[0].size))
            sigma.append(float(np.hypot(track.sigma_px, found[1])))
    return Verdicts(one.name, "real, SIFT", one.kept, np.array(off), np.array(sigma), _lost(tracks))


def by_sift(judge: Peer, frame: Frame) -> tuple[Homography, float] | None:
    """SIFT's homography and its own sigma, px; None where it is no judge.

    The sigma is the jackknife's over cells of the picture (Efron and Stein 1981): errors of neighbours are alike.
    """
    source, target = judge.matches(to_gray(frame))
    H, inlier = judge.homography(source, target)
    if H is None or int(inlier.sum()) < max(_SIFT_INLIERS, _SIFT_AGREEING * len(source)):
        return None
    source, target = source[inlier], target[inlier]
    cell = (source / np.array(frame.size) * _SIFT_CELLS).astype(int) @ np.array([1, _SIFT_CELLS])
    without = [_least_squares(source[cell != one], target[cell != one]) for one in np.unique(cell)]
    places = np.array([apply(one, grid(frame.size)) for one in without if one is not None])
    squared = np.sum((places - places.mean(axis=0)) ** 2, axis=(0, 2)) * (len(places) - 1) / len(places)
    return H, float(np.sqrt(np.mean(squared)))


def _least_squares(source: FloatArray, target: FloatArray) -> Homography | None:
    H = cv2.findHomography(source, target, 0)[0] if len(source) > 4 else None
    return None if H is None else np.asarray(H, np.float64)


def judged(options: argparse.Namespace) -> Iterator[Verdicts]:
    """Of all sequences that are asked for."""
    true = [*rendered(options.frames), *photographed(options.frames), *gusty(),
            *standing(options.videos, options.film_frames)]
    for one in (one for one in true if _wanted(options, f"{one.kind} {one.name}", one.kept)):
        yield against_truth(one)
    for film in filmed(options.videos, options.film_frames):
        if _wanted(options, f"real {film.name}", film.kept):
            yield from on_film(film)


def _wanted(options: argparse.Namespace, name: str, kept: bool) -> bool:
    return options.only in name and options.half in ("both", "kept" if kept else "chosen")


def together(verdicts: Sequence[Verdicts]) -> Iterator[Verdicts]:
    """By kind."""
    for kind in dict.fromkeys(one.kind for one in verdicts):
        alike = [one for one in verdicts if one.kind == kind]
        yield Verdicts(f"all {len(alike)}", kind, True, np.concatenate([one.off_px for one in alike]),
                       np.concatenate([one.sigma_px for one in alike]), sum(one.lost for one in alike))


def main() -> None:
    """Prints Markdown."""
    options = _parser().parse_args()
    verdicts = list(tqdm(judged(options), disable=None))
    head = ("kind", "sequence", "off, px", "sigma, px", "off / sigma, median", "within 2 sigma, %", "frames", "lost")
    print(Table("By sequence", head, [one.row() for one in verdicts]).text())
    print(Table("By kind", head, [one.row() for one in together(verdicts)]).text())
    if options.json is not None:
        told = [{"kind": one.kind, "name": one.name, "kept": one.kept, "lost": one.lost,
                 "off_px": one.off_px.tolist(), "sigma_px": one.sigma_px.tolist()} for one in verdicts]
        options.json.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Compares sigma_px with errors, by kinds of sequence.")
    parser.add_argument("--videos", type=Path, metavar="FOLDER", help="more real videos, and folders of pictures")
    parser.add_argument("--only", default="", metavar="WORD", help="sequences whose kind or name contains it")
    parser.add_argument("--half", choices=("both", "chosen", "kept"), default="both", help="of the sequences")
    parser.add_argument("--frames", type=int, default=30, help="of each sequence with truth")
    parser.add_argument("--film-frames", type=int, default=60, help="of each video")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where to write all figures")
    return parser


if __name__ == "__main__":
    main()
