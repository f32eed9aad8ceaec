"""What is doubtful of the water level on which frames are placed and depths are measured, in words."""

from __future__ import annotations

LEVEL_TIMEOUT_S = 900.0  # age above which a level is stale, where nothing else is asked for; gauges tell one in 15 min


def missing_level(wse_m: float, of: str = "no water_level has come") -> str:
    """That nothing tells the level. wse_m: default that stands for it. of: what was looked for in vain."""
    return (f"{of}, and no wse_m is given: the water surface is taken to lie at {wse_m:g} m, and the scale is that of "
            "another level if it does not")


def silent_level(topic: str, wse_m: float) -> str:
    """That a topic is published, but told nothing yet, so that the level of the settings stands for it."""
    return f"{topic} is published but has told no level yet, wse_m stands for it: {wse_m:g} m"


def stale_level(age_s: float, timeout_s: float = LEVEL_TIMEOUT_S) -> tuple[str, ...]:
    """That the last level is older than `timeout_s` under the last frame; in one line, if it is."""
    if age_s <= timeout_s:
        return ()
    return (f"the water level is {age_s:.0f} s old, it must not be older than {timeout_s:g} s: if it has changed, "
            "scale and depths are wrong",)


def late_level(after_s: float) -> tuple[str, ...]:
    """That the first level comes so long after the last frame that the water may have changed; in one line, if so."""
    if after_s <= LEVEL_TIMEOUT_S:
        return ()
    return (f"the first water level comes {after_s:.0f} s after the velocities, it must not be further away than "
            f"{LEVEL_TIMEOUT_S:g} s: if it has changed, scale and depths are wrong",)
