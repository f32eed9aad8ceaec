"""The recorder and a package of messages that only its user has: made by rosidl, compiled, sourced."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import message_package
import pytest
from live_graph import Graph
from mcap.reader import make_reader
from message_package import ROS, compiler, install_messages, sourced
from rosbags.highlevel import AnyReader

PUBLISHER = Path(message_package.__file__).with_name("gauge_publisher.py")
MESSAGES = {
    "Level": "builtin_interfaces/Time stamp\nfloat64 level_m\n",
    "Gauge": "uint8 DATUM=1  # constant\nstring site\nLevel[] levels\nfloat32[3] wind_m_s\nint16[<=4] codes\n",
}


@pytest.mark.thorough
def test_a_package_of_ones_own_is_recorded_by_its_definition(graph: Graph, tmp_path: Path,
                                                             monkeypatch: pytest.MonkeyPatch) -> None:
    found = compiler()
    if found is None:
        pytest.skip("no compiler of C and C++, or no headers of Python")
    prefix, output = tmp_path / "install", tmp_path / "out.mcap"
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(ROS))
    graph.environment = sourced(graph.environment, install_messages(prefix, "river_msgs", MESSAGES, found))
    recorder = graph.run("stab-ros", ["record", str(output), "/gauge"], ("-m", "stab_ros"))
    gauge = graph.run("gauge", [], (str(PUBLISHER),))
    assert gauge.wait() == 0, gauge.log
    assert recorder.stop() == 0, recorder.log
    assert "[WARN]" not in recorder.log
    with AnyReader([output]) as bag:
        ((connection, _, data),) = bag.messages()
        read: Any = bag.deserialize(data, connection.msgtype)
    assert (connection.msgtype, read.site) == ("river_msgs/msg/Gauge", "Aare, Bern")
    assert [(one.stamp.sec, one.stamp.nanosec, one.level_m) for one in read.levels] == [(7, 8, 2.5), (0, 0, -0.25)]
    assert ([*read.wind_m_s], [*read.codes]) == ([1, 2, -3], [1, 2, 300])
    with output.open("rb") as file:
        ((schema, channel, _),) = make_reader(file).iter_messages()
    assert schema is not None
    assert schema.data.decode().startswith(MESSAGES["Gauge"])
    hashes = json.loads((prefix / "share" / "river_msgs" / "msg" / "Gauge.json").read_text())["type_hashes"]
    assert channel.metadata["topic_type_hash"] == hashes[0]["hash_string"]
