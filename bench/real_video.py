"""A real flight without truth: do two disjoint halves of the patches agree, and does SIFT agree with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from itertools import islice
from pathlib import Path

from effort import Effort
from peers import Peer, sift_magsac
from spread import Spread
from tables import Section, Table, number, verdict
from tqdm import tqdm

from stab_ros.core.geometry import rms_distance
from stab_ros.core.gray import to_gray
from stab_ros.core.types import Frame, Homography
from stab_ros.io.video import VideoFile
from stab_ros.parameters.engines import make_stabilizer

VIDEO = Path(__file__).resolve().parents[2] / "shared" / "data" / "navizence.mp4"
HALVES, SIFT = "even patches and odd patches", f"direct and {sift_magsac().name}"
TARGETS_PX = {HALVES: 0.03, SIFT: 0.08}  # medians

Answers = Mapping[str, Homography | None]


def measure(effort: Effort) -> Section:
    """Empty where the video is not there."""
    title = f"Real video: {VIDEO.name}"
    if not VIDEO.is_file():
        return Section(title, [Table("Left out", ("no such file",), [(VIDEO.name,)])], {})
    answers = list(_answers(effort))
    distances = {HALVES: _distances(answers, "even", "odd"), SIFT: _distances(answers, "all", "sift")}
    tracked = sum(answer["all"] is not None for answer in answers)
    rows = [_row(name, Spread.of(found)) for name, found in distances.items()]
    head = ("distance, px", "median", "95 %", "max", "frames", "target", "met")
    table = Table(f"{tracked} of {len(answers)} frames tracked", head, rows)
    data: dict[str, object] = {"frames": len(answers), "tracked": tracked}
    for name, found in distances.items():
        data[name] = {"distance_px": Spread.of(found).data(), "target_median_px": TARGETS_PX[name]}
    return Section(title, [table], data)


def _frames(limit: int | None) -> Iterator[Frame]:
    with closing(VideoFile(VIDEO, None)) as video:
        for _, frame in tqdm(islice(video.frames(), limit), "video", limit or video.count, disable=None, leave=False):
            if isinstance(frame, Frame):
                yield frame


def _answers(effort: Effort) -> Iterator[Answers]:
    """For each frame the homography by all patches, by either half of them, and of some by SIFT."""
    engines = {subset: _tracked(effort, subset) for subset in ("all", "even", "odd")}
    peer: Peer | None = None
    for number_, frame in enumerate(_frames(effort.video)):
        answer = {subset: tracked[number_] for subset, tracked in engines.items()}
        if number_ % effort.sift_every == 0:
            gray = to_gray(frame)
            peer = peer or Peer(sift_magsac(), gray)
            answer["sift"] = peer.ref_H_cur(gray)
        yield answer


def _tracked(effort: Effort, subset: str) -> list[Homography | None]:
    """As the command answers, the start included: there all patches are followed, so the halves differ after it."""
    stabilizer = make_stabilizer({"direct.subset": subset})
    tracks = [track for frame in _frames(effort.video) for track in stabilizer.answers(frame)] + stabilizer.finish()
    return [track.ref_H_cur for track in tracks]


def _distances(answers: list[Answers], one: str, other: str) -> list[float]:
    """In px, of the frames but the reference that both have an answer for."""
    size = next(_frames(1)).size
    pairs = [(answer.get(one), answer.get(other)) for answer in answers[1:]]
    return [rms_distance(a, b, size) for a, b in pairs if a is not None and b is not None]


def _row(name: str, spread: Spread) -> tuple[str, ...]:
    return (name, number(spread.median, 4), number(spread.p95, 4), number(spread.max, 4), str(spread.count),
            *verdict(spread.median, TARGETS_PX[name]))
