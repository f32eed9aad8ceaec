"""What filters have dropped, as users are told."""

from __future__ import annotations

from stab_ros.velocimetry.dropped import bed_doubt, dropped_text


def test_only_reasons_that_held_are_named() -> None:
    assert dropped_text({"dragged": 12, "min_track": 0, "local_median": 3}) == "12 dragged, 3 local_median"
    assert dropped_text({"min_track": 0}) == "none"


def test_a_bed_is_told_where_it_dragged_more_than_a_tenth_along() -> None:
    assert "12 vectors" in bed_doubt({"dragged": 12, "local_median": 8}, kept=80)
    assert not bed_doubt({"dragged": 10, "local_median": 10}, kept=80)
    assert not bed_doubt({"local_median": 90}, kept=10)
    assert not bed_doubt({}, kept=0)
