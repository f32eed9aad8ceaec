"""Message classes by the name of their type."""

from __future__ import annotations

import pytest

from stab_ros.core.errors import InputError
from stab_ros.nodes.runtime import message_class


def test_types_by_name() -> None:
    assert message_class("std_msgs/msg/String").__name__ == "String"
    for unknown in ("std_msgs/msg/Nothing", "nobody_msgs/msg/String"):
        with pytest.raises(InputError, match="is not installed"):
            message_class(unknown)
    for nonsense in ("String", "", "std_msgs/srv/String", "os.path/msg/join"):
        with pytest.raises(InputError, match="is no message type"):
            message_class(nonsense)
