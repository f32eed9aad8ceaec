"""Quality of service: chosen by the publishers' offers, recorded and replayed."""

from __future__ import annotations

import pytest
import yaml
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from stab_ros.nodes import qos

RELIABLE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.mark.parametrize(
    ("offers", "reliability", "durability"),
    [
        ([], ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
        ([RELIABLE], ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
        ([RELIABLE, BEST_EFFORT], ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
        ([LATCHED, LATCHED], ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL),
        ([LATCHED, RELIABLE], ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
    ],
)
def test_qos_follows_the_publishers(
    offers: list[QoSProfile], reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> None:
    recorded = qos.keep_all_offered(offers)
    assert (recorded.history, recorded.reliability, recorded.durability) == (
        HistoryPolicy.KEEP_ALL, reliability, durability)
    newest = qos.newest_only(offers)
    assert (newest.depth, newest.reliability, newest.durability) == (1, reliability, DurabilityPolicy.VOLATILE)
    assert qos.keep_all_reliable(offers).reliability == ReliabilityPolicy.RELIABLE


@pytest.mark.parametrize("offer", [RELIABLE, BEST_EFFORT, LATCHED])
def test_recorded_qos_is_offered_again(offer: QoSProfile) -> None:
    written = qos.offered_yaml([offer, offer])
    replayed = qos.replay_qos(written)
    assert (replayed.reliability, replayed.durability) == (offer.reliability, offer.durability)
    assert yaml.safe_load(written)[0]["deadline"] == {"sec": 9223372036, "nsec": 854775807}  # as rosbag2
    assert "&" not in written


@pytest.mark.parametrize(
    ("recorded", "reliability", "durability"),
    [
        ("- history: 3\n  depth: 0\n  reliability: 2\n  durability: 2\n", "BEST_EFFORT", "VOLATILE"),  # Humble
        ("- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n", "RELIABLE", "TRANSIENT_LOCAL"),
        ("- reliability: best_effort\n- reliability: reliable\n", "RELIABLE", "VOLATILE"),  # they differed
        ("", "RELIABLE", "VOLATILE"),
        ("- reliability: [1, 2]\n", "RELIABLE", "VOLATILE"),
        ("- 5\n- {", "RELIABLE", "VOLATILE"),
        ("hello", "RELIABLE", "VOLATILE"),
    ],
)
def test_replayed_qos_of_other_recorders(recorded: str, reliability: str, durability: str) -> None:
    offered = qos.replay_qos(recorded)
    assert (offered.reliability.name, offered.durability.name) == (reliability, durability)
