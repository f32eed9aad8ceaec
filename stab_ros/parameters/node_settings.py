"""Settings of the live nodes themselves, beside those of their engines; below `nodes`, as parameter files hold both."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.settings import Checked, setting


@dataclass(frozen=True)
class TrackerSettings(Checked):
    """Settings of the tracker node."""

    queue_depth: int = setting(1, "1: the newest frame wins; 0: every frame is kept, RELIABLE", 0, 1)
    image_transport: str = setting("raw", "subscribe to image_raw or to image_raw/compressed",
                                   choices=("raw", "compressed"))
    wait_for_subscribers: int = setting(0, "take images only once so many subscribers match homography", 0, 1000)
    stale_s: float = setting(2.0, "free to take an image, and without one for so long, the state is STALE, s", 0.05,
                             3600.0)
    reference_path: str = setting("", "an .mcap file that the reference is saved to, and that a tracker goes on from "
                                  'when it is started again; "": each start has a reference of its own')


@dataclass(frozen=True)
class EvaluatorSettings(Checked):
    """Settings of the evaluator node."""

    window_s: float = setting(60.0, "statistics on /diagnostics are over the last so many seconds, s", 1.0, 86400.0)
    alarm_s: float = setting(3.0, "/diagnostics tells a problem of a frame for so long, s", 1.0, 3600.0)
    stale_s: float = setting(1.0, "free to take an image, and without one for so long, the stream counts as stopped, s",
                             0.05, 3600.0)
    backlog_mb: float = setting(512.0, "pictures that may wait to be measured, MB in gray; more than half: RMSE and "
                                "velocity field are skipped; all: the oldest frame is skipped", 0.1, 1e6)
    wait_for_subscribers: int = setting(0, "take images only once so many subscribers match ~/metrics", 0, 1000)
