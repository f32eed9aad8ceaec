"""Quality of service that users override: in force, described, and never ignored in silence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from live_graph import Graph
from rcl_interfaces.srv import DescribeParameters, GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

BEST_EFFORT, RELIABLE = ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE


def file_of(tmp_path: Path, overrides: dict[str, Any], **others: Any) -> str:
    config = tmp_path / "qos.yaml"
    config.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"qos_overrides": overrides, **others}}}))
    return str(config)


def test_overrides_hold_for_publishers_and_subscriptions(graph: Graph, tmp_path: Path) -> None:
    config = file_of(tmp_path, {
        "/cam/homography": {"publisher": {"reliability": "best_effort", "depth": 7}},
        "/cam/tracker_node/track": {"publisher": {"durability": "transient_local", "lifespan": 10**9}},
        "/cam/image_raw": {"subscription": {"reliability": "best_effort"}},
        "/diagnostics": {"publisher": {"reliability": "best_effort"}},
    })
    images = graph.node.create_publisher(Image, "/cam/image_raw", 10)
    tracker = graph.run("tracker_node", ["--ros-args", "-r", "__ns:=/cam", "--params-file", config])
    graph.until(images.get_subscription_count, "the tracker taking images")

    def published(topic: str) -> QoSProfile:
        graph.until(lambda: graph.node.get_publishers_info_by_topic(topic), f"a publisher of {topic}")
        (publisher,) = graph.node.get_publishers_info_by_topic(topic)
        offered: QoSProfile = publisher.qos_profile
        return offered

    assert published("/cam/homography").reliability == BEST_EFFORT
    assert published("/diagnostics").reliability == BEST_EFFORT
    assert published("/cam/tracker_node/track").durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert published("/cam/tracker_node/track").lifespan.nanoseconds == 10**9
    assert published("/cam/image_stabilized").reliability == RELIABLE
    (taken,) = graph.node.get_subscriptions_info_by_topic("/cam/image_raw")
    assert taken.qos_profile.reliability == BEST_EFFORT  # though its publisher offers more
    names = ["qos_overrides./cam/homography.publisher.depth", "qos_overrides./cam/image_raw.subscription.reliability"]
    request = DescribeParameters.Request(names=names)
    shown = graph.call(DescribeParameters, "/cam/tracker_node/describe_parameters", request).descriptors
    assert all(one.read_only and one.description for one in shown)
    assert "no effect" not in tracker.log


def test_a_subscription_follows_its_publishers_unless_told_otherwise(graph: Graph, tmp_path: Path) -> None:
    """One that is made anew for another publisher keeps what the user has said."""
    config = file_of(tmp_path, {"/homography": {"subscription": {"reliability": "best_effort"}}})
    graph.run("evaluator_node", ["--ros-args", "--params-file", config])
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.until(lambda: graph.node.count_subscribers("/homography"), "the evaluator")
    graph.node.create_publisher(CameraInfo, "/homography", latched)

    def taken() -> Any:
        return [one.qos_profile for one in graph.node.get_subscriptions_info_by_topic("/homography")]

    graph.until(lambda: [one.durability for one in taken()] == [DurabilityPolicy.TRANSIENT_LOCAL], "another durability")
    assert taken()[0].reliability == BEST_EFFORT


@pytest.mark.parametrize(("override", "said"), [
    ({"/homography": {"publisher": {"reliability": "best_efort"}}},
     "qos_overrides./homography.publisher.reliability: 'best_efort' is unknown, did you mean best_effort"),
    ({"/homography": {"publisher": {"depth": "ten"}}},
     "qos_overrides./homography.publisher.depth: 'ten' is a str, it must be a int"),
    ({"/image_raw": {"subscription": {"depth": -1}}},
     "qos_overrides./image_raw.subscription.depth: -1 is out of range"),
])
def test_what_is_no_quality_of_service_is_one_line(
    graph: Graph, tmp_path: Path, override: dict[str, Any], said: str
) -> None:
    tracker = graph.run("tracker_node", ["--ros-args", "--params-file", file_of(tmp_path, override)])
    assert tracker.wait() == 2
    (line,) = tracker.log.splitlines()
    assert said in line


def test_what_nothing_uses_is_told_with_the_nearest_name(graph: Graph, tmp_path: Path) -> None:
    config = file_of(tmp_path, {
        "/homografy": {"publisher": {"depth": 7}}, "/homography": {"publisher": {"dept": 7}, "publsher": {"depth": 7}},
    }, metod="klt")
    tracker = graph.run("tracker_node", ["--ros-args", "--params-file", config, "-p", "exlude:=a.png",
                                         "-p", "trackr_node:method:=klt", "-r", "trackr_node:image_raw:=/x",
                                         "-r", "imge_raw:=/x", "-r", "/rosout:=/log", "-r", "velocity:=/v"])
    graph.until(lambda: tracker.log.count("so far") == 2, "the override and the remapping of other topics")
    said = [line for line in tracker.log.splitlines() if "no effect" in line or "had no effect" in line]
    assert "-p trackr_node:method:=klt: nothing of it applies, it is for /trackr_node, and this" in tracker.log
    assert tracker.log.count("-r ") == 2
    assert "-r trackr_node:image_raw:=/x: nothing of it applies, it is for a node trackr_node" in tracker.log
    assert ("-r imge_raw:=/x has had no effect: there is no topic or service imge_raw of /tracker_node so far; did you "
            "mean image_raw?") in tracker.log
    said = [line for line in said if "parameter " in line]
    assert len(said) == 5
    for name, meant in [
        ("metod", "did you mean method or model?"), ("exlude", "did you mean exclude?"),
        ("qos_overrides./homography.publisher.dept", "did you mean depth?"),
        ("qos_overrides./homography.publsher.depth",
         "did you mean publisher? It must be qos_overrides./TOPIC.publisher.POLICY"),
        ("qos_overrides./homografy.publisher.depth", "did you mean qos_overrides./homography.publisher.depth"),
    ]:
        (line,) = [one for one in said if f"parameter {name} " in one]
        assert meant in line


def test_what_is_set_before_configure_comes_before_what_was_given_at_the_start(graph: Graph) -> None:
    override = "qos_overrides./homography.publisher.reliability"
    graph.run("tracker_node", ["--ros-args", "-p", "autostart:=false", "-p", f"{override}:=best_effort"])
    assert graph.set_parameter("tracker_node", override, "reliable") == (True, "")
    configure = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    assert graph.call(ChangeState, "tracker_node/change_state", configure).success
    graph.until(lambda: graph.node.get_publishers_info_by_topic("/homography"), "the tracker")
    (offered,) = graph.node.get_publishers_info_by_topic("/homography")
    assert offered.qos_profile.reliability == RELIABLE
    shown = graph.call(GetParameters, "tracker_node/get_parameters", GetParameters.Request(names=[override]))
    assert [one.string_value for one in shown.values] == ["reliable"]


def test_what_is_set_before_configure_is_judged_by_it_and_fixed_from_then_on(graph: Graph) -> None:
    override = "qos_overrides./image_raw.subscription.reliability"

    def changed(transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(graph.call(ChangeState, "tracker_node/change_state", request).success)

    tracker = graph.start("tracker_node", autostart=False)
    assert graph.set_parameter("tracker_node", override, "best_efort") == (True, "")
    assert not changed(Transition.TRANSITION_CONFIGURE)
    assert f"cannot configure: {override}: 'best_efort' is unknown, did you mean best_effort" in tracker.log
    assert graph.set_parameter("tracker_node", override, "best_effort") == (True, "")
    assert changed(Transition.TRANSITION_CONFIGURE)
    assert changed(Transition.TRANSITION_ACTIVATE)
    graph.until(lambda: graph.node.get_subscriptions_info_by_topic("/image_raw"), "the tracker")
    (taken,) = graph.node.get_subscriptions_info_by_topic("/image_raw")
    assert taken.qos_profile.reliability == BEST_EFFORT
    for name in ("qos_overrides./image_raw.subscription.durability", "qos_overrides./other.publisher.reliability"):
        taken_up, reason = graph.set_parameter("tracker_node", name, "best_effort")
        assert not taken_up
        assert reason == f"{name} is fixed while the node is configured, set it after cleanup"
    taken_up, reason = graph.set_parameter("tracker_node", override, "reliable")  # in use, so rclpy has declared it
    assert not taken_up
    assert "read-only" in reason
