"""What is doubtful of the water level on which frames are placed, in words."""

from __future__ import annotations

LEVEL_TIMEOUT_S = 900.0  # age from which a level is stale, where nothing else is asked for


def missing_level(wse_m: float, of: str = "no water_level has come") -> str:
    """That nothing tells the level. wse_m: default that stands for it. of: what was looked for in vain."""
    return (f"{of}, and no wse_m is given: the water surface is taken to lie at {wse_m:g} m, and the scale is that of "
            "another level if it does not")


def silent_level(topic: str, wse_m: float) -> str:
    """That a topic is published, but told nothing yet, so that the level of the settings stands for it."""
    return f"{topic} is published but has told no level yet, wse_m stands for it: {wse_m:g} m"


def stale_level(age_s: float) -> str:
    """That the last level is old."""
    return f"water_level is {age_s:.0f} s old; if it has changed, the scale is wrong"
