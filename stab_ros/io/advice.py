"""Sentences for the user about what the tracker has found: what it is, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from stab_ros.core.text import are, counted
from stab_ros.core.types import Frame, LostReason, ResetReason
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.rolling_shutter import Swing

_MANY_LOST = 0.05  # of the frames
_MUCH_FIXED = 0.005  # of the picture

_TO_TRY: Mapping[LostReason, str] = MappingProxyType({
    LostReason.UNUSABLE: "images must be readable and of one size; `stab-ros recover` saves what is readable in a "
                         "damaged MCAP",
    LostReason.INTERNAL: "this is a bug of stab_ros, which the log describes; please report it",
    LostReason.UNANSWERED: "see whether the tracker was running, and what it logged",
    LostReason.STARTING: "the ground is chosen from the frames of the first start_s; set answer_start:=late to have "
                         "them answered then, or name the ground in roi or exclude",
    LostReason.NO_TEXTURE: "the picture is flat, dark, covered or out of focus; see to exposure, focus and lens, or "
                           "leave that part of the recording out",
    LostReason.NO_FEATURES: "nothing of the reference is recognised; set reference:=keyframe where the view leaves the "
                            "first one, split the recording where it is cut, and see whether pictures are blurred",
    LostReason.FEW_INLIERS: "too little of the reference is recognised; set reference:=keyframe where the view leaves "
                            "the first one, split the recording where it is cut, or leave less out by exclude",
    LostReason.IMPLAUSIBLE: "what is recognised moves as no camera does; name the water in exclude or the banks in roi",
    LostReason.UNCERTAIN: "the ground that is recognised is too little or on one side only, as one bank; set a simpler "
                          "model:=similarity, name more ground in roi, or leave less out by exclude",
})

_ANEW: Mapping[ResetReason, str] = MappingProxyType({
    ResetReason.SIZE: "the images have another size, {kind}",
    ResetReason.DEPTH: "the images have another bit depth, {kind}",
    ResetReason.GIVEN_UP: "the reference before matched no image after it, as a damaged one does",
    ResetReason.GROUND: "another plane turned out to be the ground",
    ResetReason.ASKED: "another reference was asked for",
})
_NAMED = 3  # resets in one line


def to_try(reason: LostReason) -> str:
    """What frames that are lost for a reason show, and what may help."""
    return _TO_TRY[reason]


def by_reason(lost: Mapping[LostReason, int]) -> str:
    """The numbers of lost frames, the most frequent reason first."""
    return ", ".join(f"{count} {reason.value}" for reason, count in sorted(lost.items(), key=lambda item: -item[1]))


def often_lost(lost: Mapping[LostReason, int], frames: int) -> str:
    """If many of the frames are lost: the most frequent reason, and what to try; else an empty string."""
    total = sum(lost.values())
    if total <= _MANY_LOST * frames:
        return ""
    reason = max(lost, key=lambda one: lost[one])
    return (f"{total} of {counted(frames, 'frame')} {are(total)} lost, most often {reason.value} ({lost[reason]}): "
            f"{to_try(reason)}")


@dataclass(frozen=True)
class Reset:
    """A rise of `reset_counter`. frame: number of the first image that was tracked after it; kind: as `Frame.kind`."""

    frame: int
    reason: ResetReason | None
    kind: str


class FixedToCamera:
    """Tells once of each reference that parts of the picture move with the camera."""

    def __init__(self) -> None:
        self._told: Frame | None = None  # the reference of which it was

    def news(self, reference: Frame | None, share: float) -> str:
        """share: of the picture that is fixed to the camera, in [0, 1]. An empty string: it is small, or was told."""
        if reference is None or reference is self._told or share <= _MUCH_FIXED:
            return ""
        self._told = reference
        return (f"{100 * share:.1f} % of the picture is fixed to the camera (overlay, dirt, hot pixels, borders) and "
                "is not used as ground")


def simpler_model(frames: int) -> str:
    """So many frames were registered by a simpler model than asked for; an empty string for none."""
    if not frames:
        return ""
    return (f"{counted(frames, 'frame shows', 'frames show')} ground on one side only, so a similarity took the "
            "place of the model asked for; sigma_px includes what it leaves out")


def why_anew(reason: ResetReason | None, kind: str) -> str:
    """Why homographies begin anew with an image of this kind, as `Frame.kind`."""
    return "" if reason is None else _ANEW[reason].format(kind=kind)


def begun_anew(resets: Sequence[Reset]) -> str:
    """Where homographies begin anew, and why; an empty string: nowhere."""
    if not resets:
        return ""
    named = [f"at frame {one.frame} ({why_anew(one.reason, one.kind)})" for one in resets[:_NAMED]]
    more = f" and at {counted(len(resets) - _NAMED, 'more frame')}" if len(resets) > _NAMED else ""
    return (f"homographies begin anew {', '.join(named)}{more}; those of different reset_counter belong to different "
            "references or ground")


def remarks(competing: CompetingHypothesis | None, relief: Relief | None, swing: Swing | None,
            copied: float | None) -> list[str]:
    """One sentence for each reason why homographies may be wrong; None: there is no such reason."""
    found = [] if competing is None else [ambiguous_ground(competing)]
    found = found if relief is None else [*found, parallax(relief)]
    found = found if swing is None else [*found, rolling_shutter(swing)]
    return found if copied is None else [*found, copied_by_codec(copied)]


def ambiguous_ground(competing: CompetingHypothesis) -> str:
    """A second plane may be the ground as well as the chosen one."""
    chosen, other = (f"goes {_heading(drift)}" for drift in (competing.ground_drift_px, competing.drift_px))
    return (f"what is ground is ambiguous: taken is a plane with {100 * (1 - competing.share):.0f} % of the features, "
            f"which {chosen}; another with {100 * competing.share:.0f} %, which {other}, may be it as well; "
            "name the water in exclude or the banks in roi")


def parallax(relief: Relief) -> str:
    """The ground is not one plane."""
    return (f"parallax: parts of the ground are shifted against the rest by {relief.px:.2f} px towards "
            f"{relief.deg:.0f} or {relief.deg + 180:.0f} degrees, as if they were no plane; homographies may "
            "be off by several times that, name ground at the height of the water in roi")


def rolling_shutter(swing: Swing) -> str:
    """Rows are shifted against each other."""
    return (f"rolling shutter: the rows of {counted(swing.frames, 'frame')} swing by up to {swing.most_px:.2f} px; "
            "image_stabilized corrects it, homographies alone do not, sigma_px includes what they leave")


def copied_by_codec(share: float) -> str:
    """Little of the picture is new from frame to frame."""
    return (f"low bitrate: the video codec has copied {100 * share:.0f} % of what is tracked from earlier frames, so a "
            "motion of the camera may not be in the pictures, and sigma_px does not include that; "
            "ignore it if the camera stood still, else record at a higher bitrate")


def _heading(rate_px: tuple[float, float]) -> str:
    """Speed and direction, 0 degrees to the right, 90 down."""
    degrees = round(math.degrees(math.atan2(rate_px[1], rate_px[0]))) % 360
    return f"{math.hypot(*rate_px):.1f} px/s towards {degrees} degrees"
