"""Rules of a command line that remap what no node has: told; those that nodes use or may use: not."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import rclpy
from live_graph import next_domain
from rclpy.context import Context
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.params import DeclaringNode
from stab_ros.nodes.remappings import rules_for_others, unused_rules


class OfBags(DeclaringNode):
    """As player and recorder."""

    OF_BAGS = True


MakeNodes = Callable[..., list[DeclaringNode]]


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch) -> Iterator[MakeNodes]:
    """Nodes of one process with these arguments, each with a topic and a service."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context, nodes = Context(), list[DeclaringNode]()

    def make(words: list[str], *names: str, kind: type[DeclaringNode] = DeclaringNode,
             topic: str = "image_raw") -> list[DeclaringNode]:
        rclpy.init(args=words, context=context, domain_id=next_domain())
        for name in names:
            nodes.append(kind(name, context=context))
            nodes[-1].create_service(Trigger, "~/reset_reference", lambda _, response: response)
            nodes[-1].create_publisher(Image, nodes[-1].resolve_topic_name(topic), 1)
        return nodes

    yield make
    for node in nodes:
        node.destroy_node()
    context.shutdown()


def told(make_node: MakeNodes, *rules: str, nodes: tuple[str, ...] = ("tracker_node",)) -> list[str]:
    words = ["x", "--ros-args", *(word for rule in rules for word in ("-r", rule))]
    made = make_node(words, *nodes)
    return [*rules_for_others(words, made), *unused_rules(words, made)]


@pytest.mark.parametrize("rule", [
    "image_raw:=/x", "/cam/image_raw:=/x", "rostopic://image_raw:=x", "tracker_node:image_raw:=/x", "image_raw/h264:=x",
    "~/reset_reference:=/reset", "tracker_node/reset_reference:=/reset", "/cam/tracker_node/set_parameters:=/set",
    "homography:=/h", "camera_info:=/c", "~/track:=/t", "tracker_node/track:=/t",  # which a node may take later
    "/rosout:=/log", "/tf:=tf", "/clock:=c", "/parameter_events:=/p", "~/change_state:=/s", "/diagnostics:=d",
])
def test_what_is_used_or_may_be_is_not_told(make_node: MakeNodes, rule: str) -> None:
    assert told(make_node, "__ns:=/cam", rule) == []


@pytest.mark.parametrize(("rule", "meant"), [
    ("imge_raw:=/x", "imge_raw of /cam/tracker_node so far; did you mean image_raw"),
    ("/camra/image_raw:=/x", "/camra/image_raw of /cam/tracker_node so far; did you mean /cam/image_raw"),
    ("~/rest_reference:=/x", "~/rest_reference of /cam/tracker_node so far; did you mean ~/reset_reference"),
    ("zzzz:=/x", "zzzz of /cam/tracker_node so far"),
])
def test_what_nothing_uses_is_told(make_node: MakeNodes, rule: str, meant: str) -> None:
    (line,) = told(make_node, "__ns:=/cam", rule)
    assert line.startswith(f"-r {rule} has had no effect: there is no topic or service {meant}")


def test_a_player_has_the_topics_of_its_recording(make_node: MakeNodes) -> None:
    words = ["x", "--ros-args", "-r", "image_raw:=/x", "-r", "/cam/image_raw:=/y"]
    (node,) = make_node(words, "bag_player_node", kind=OfBags, topic="/cam/image_raw")
    (line,) = unused_rules(words, [node])
    assert line.startswith("-r image_raw:=/x has had no effect: ")
    assert line.endswith("did you mean cam/image_raw?")


def test_a_rule_for_one_node_names_it_as_it_is_called(make_node: MakeNodes) -> None:
    used = told(make_node, "tracker_node:__node:=steady", "steady:image_raw:=/x", "velocimetry_node:image_raw:=/y",
                "evaluatr_node:image_raw:=/z", "tracker_node:image_raw:=/u", "steady:imge_raw:=/x",
                nodes=("tracker_node", "velocimetry_node"))
    assert [line.split(": ", 1)[0] for line in used] == [
        "-r evaluatr_node:image_raw:=/z", "-r tracker_node:image_raw:=/u", "-r steady:imge_raw:=/x has had no effect"]
    assert "it is for a node tracker_node, and the nodes here are /steady, /velocimetry_node" in used[1]


def test_the_service_of_the_states_may_have_any_name(make_node: MakeNodes) -> None:
    (node,) = make_node(["x", "--ros-args", "-r", "~/change_state:=/go", "-p", "autostart:=false"], "managed",
                        kind=StabNode)
    assert "/go" in {service.service_name for service in node.services}
