"""The worst frame of each method over its reference, beside the same raw frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from markupsafe import Markup

from stab_ros.core.gray import GreyRange, grey_range, to_gray
from stab_ros.core.progress import Progress
from stab_ros.core.types import Frame, Gray, Homography, Image
from stab_ros.evaluation.comparison_results import Comparison, MethodResult
from stab_ros.io.frame_reader import Decoded
from stab_ros.report.numbers import Numbers
from stab_ros.report.overlay import Pair, part, worst_place
from stab_ros.report.panel import Panel, gray_of
from stab_ros.report.sampling import worst_frames


@dataclass(frozen=True)
class _Worst:
    """The worst frame of a method. measure: name of the metric in `per_frame`. text: how the caption states it."""

    result: MethodResult
    number: int
    measure: str
    text: str


class Warp(Protocol):
    """Warps a frame to the reference with the interpolation and the camera of a method."""

    def __call__(self, method: str, frame: Frame, ref_H_cur: Homography) -> Image: ...


def overlay_panels(comparison: Comparison, frames: Iterable[Decoded], warp: Warp, numbers: Numbers,
                   progress: Progress) -> list[Panel]:
    """Two panels for each method. frames: those of the comparison, in order; none is kept."""
    worst = [one for result in comparison.methods if (one := _worst(result)) is not None]
    made: dict[str, list[Panel]] = {}
    for number, decoded in enumerate(frames):
        progress(number + 1, max(number + 1, comparison.frames))
        for one in worst:
            if one.number == number and isinstance(decoded, Frame):
                made[one.result.name] = list(_pair(one, decoded, warp, numbers))
    nothing = "It aligned no frame, so there is nothing to draw."
    return [panel for one in comparison.methods if not one.failure
            for panel in made.get(one.name, [Panel(f"{one.name}: worst frame", nothing)])]


def _worst(result: MethodResult) -> _Worst | None:
    """The frame with the largest error if the truth is known, else with the largest displacement."""
    if result.evaluation is None:
        return None
    known = [(one.error_px, one.number) for one in result.aligned if one.error_px is not None]
    if known:
        return _Worst(result, max(known)[1], "error_px", "Error {} px. ")
    rows = worst_frames(result.evaluation)
    if rows and result.passages[rows[0]].track.tracked:
        return _Worst(result, rows[0], "displacement_reference_px", "Displaced by {} px. ")
    return None


def _pair(worst: _Worst, frame: Frame, warp: Warp, numbers: Numbers) -> Iterator[Panel]:
    evaluation, H = worst.result.evaluation, worst.result.passages[worst.number].track.ref_H_cur
    if evaluation is None or H is None or frame.size != evaluation.reference.size:
        return
    like = evaluation.reference if evaluation.reference.is_like(frame) else frame  # 16-bit colour is warped to 8 bits
    shown, reference = grey_range(like), gray_of(evaluation.reference)
    place = worst_place(evaluation, evaluation.rows[worst.number])
    steady = warp(worst.result.name, frame, H)
    title = f"{worst.result.name}: worst frame ({worst.number})"
    caption = Markup(worst.text).format(numbers("methods", worst.result.name, "per_frame", worst.number, worst.measure))
    yield part(Pair(title, reference, _gray(steady, frame, shown), *place), caption)
    yield part(Pair(f"{worst.result.name}: the same frame, raw", reference, to_gray(frame, shown), *place))


def _gray(image: Image, frame: Frame, shown: GreyRange) -> Gray:
    return to_gray(Frame(image, frame.encoding, frame.stamp_ns), shown)
