"""diagnostic_msgs/DiagnosticArray with one status: /diagnostics, and keys and values of each frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.evaluation.findings import Level
from stab_ros.io.cdr import DIAGNOSTIC_ARRAY, Header, deserialize, header_message, serialize

OK, WARN, ERROR = Level


def diagnostics_cdr(
    stamp_ns: int, name: str, hardware_id: str, level: int, message: str, values: Mapping[str, str]
) -> bytes:
    """A status for /diagnostics."""
    return status_cdr(Header(stamp_ns), name, hardware_id, level, message, values)


def status_cdr(
    header: Header, name: str, hardware_id: str, level: int, message: str, values: Mapping[str, str]
) -> bytes:
    """A DiagnosticArray with this one status."""
    pairs = [ros.diagnostic_msgs__msg__KeyValue(key=key, value=value) for key, value in values.items()]
    status = ros.diagnostic_msgs__msg__DiagnosticStatus(
        level=level, name=name, message=message, hardware_id=hardware_id, values=pairs)
    array = ros.diagnostic_msgs__msg__DiagnosticArray(header=header_message(header), status=[status])
    return serialize(array, DIAGNOSTIC_ARRAY)


def read_values(cdr: bytes | memoryview) -> dict[str, str]:
    """The keys and values of the first status; empty without a status.

    Raises:
        MessageError: damaged.
    """
    message = cast(ros.diagnostic_msgs__msg__DiagnosticArray, deserialize(cdr, DIAGNOSTIC_ARRAY))
    return {pair.key: pair.value for status in message.status[:1] for pair in status.values}
