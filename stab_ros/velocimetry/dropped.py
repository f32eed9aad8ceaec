"""What filters have dropped, in words."""

from __future__ import annotations

from collections.abc import Container, Mapping

_MANY = 0.1  # share of the vectors that a bed has dragged along from which on it is told


def dropped_text(dropped: Mapping[str, int]) -> str:
    """Numbers of vectors by reason, those of which there are any: `192 dragged, 3 local_median`; else `none`."""
    return ", ".join(f"{count} {reason}" for reason, count in dropped.items() if count) or "none"


def bed_doubt(dropped: Mapping[str, int], kept: int, others: Container[str] = ()) -> str:
    """What is to be said where many vectors were dragged along by a bed; empty: few were, or by what repeats.

    Args:
        dropped: numbers of vectors by reason.
        kept: number of those that are left.
        others: kinds of other doubts.
    """
    dragged = dropped.get("dragged", 0)
    if "repeats" in others or dragged <= _MANY * (kept + sum(dropped.values())):
        return ""
    return (f"{dragged} vectors were dropped, as something stands where the water has moved on, like a bed that shows "
            f"through; of the {kept} that are left some may be its, min_speed drops them")


def repeats_doubt(period_px: float, gone: int, seeded: int) -> str:
    """What is to be said where many features are `gone`, of `seeded`, of a texture that repeats every period_px."""
    return (f"{gone} of {seeded} features of a texture that repeats every {period_px:.0f} px were lost or dropped: "
            "water that goes more than half of that from frame to frame is followed to the wrong repetition, also by "
            "vectors that are left; method lspiv seeks farther and leaves out what it cannot tell apart "
            "(lspiv.max_speed_m_s)")
