"""DiagnosticArray as ROS 2 (rclpy) reads it, and damaged."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import HEADER, complaint, damaged
from rclpy.serialization import deserialize_message, serialize_message

from stab_ros.io.diagnostics_message import diagnostics_cdr, read_values


def test_diagnostics_in_full() -> None:
    message = deserialize_message(
        diagnostics_cdr(HEADER.stamp_ns, "tracker", "camera 1", 2, "late", {"latency_ms": "31", "über": "ü"}),
        DiagnosticArray)
    (status,) = message.status
    assert (status.level, status.name, status.hardware_id, status.message) == (b"\x02", "tracker", "camera 1", "late")
    assert {pair.key: pair.value for pair in status.values} == {"latency_ms": "31", "über": "ü"}
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == HEADER.stamp_ns


def test_values_are_those_of_the_first_status() -> None:
    cdr = diagnostics_cdr(HEADER.stamp_ns, "tracker", "camera 1", 0, "fine", {"a": "1", "b": ""})
    assert read_values(cdr) == {"a": "1", "b": ""}
    assert read_values(serialize_message(DiagnosticArray())) == {}


@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(data: st.DataObject) -> None:
    sound = diagnostics_cdr(HEADER.stamp_ns, "tracker", "camera 1", 2, "late", {"a": "1"})
    assert len(complaint(read_values, data.draw(damaged(sound))).splitlines()) <= 1
