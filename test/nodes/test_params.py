"""ROS parameters: declared with description and range, overridden, and changed at run time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import pytest
import rclpy
from live_graph import next_domain
from rclpy.context import Context
from rclpy.parameter import Parameter as RosParameter

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.nodes import params
from stab_ros.nodes.params import DeclaringNode
from stab_ros.nodes.tracker_node import SETTINGS
from stab_ros.parameters.table import PARAMETERS

MakeNode: TypeAlias = Callable[..., DeclaringNode]


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., DeclaringNode]]:
    """Nodes with these parameters given, as on a command line."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = Context()
    rclpy.init(context=context, domain_id=next_domain())
    nodes: list[DeclaringNode] = []

    def make(**given_values: Any) -> DeclaringNode:
        nodes.append(params.DeclaringNode("node", given_values, context=context))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    context.shutdown()


def test_all_parameters_are_declared_with_their_meaning_and_range(make_node: MakeNode) -> None:
    node = make_node()
    table = {**PARAMETERS, **SETTINGS}
    values = params.declare(node, table, changeable=PARAMETERS)
    assert values == {name: one.default for name, one in table.items()}
    for name, one in table.items():
        shown = node.describe_parameter(name)
        assert shown.description == one.limits.doc
        assert shown.read_only == (name in SETTINGS)
        assert node.get_parameter(name).value == one.default
        if one.limits.choices:
            assert shown.additional_constraints == f"one of {', '.join(one.limits.choices)}"
        elif one.limits.high is not None:
            (bounds,) = shown.integer_range or shown.floating_point_range
            assert (bounds.from_value, bounds.to_value) == (one.limits.low, one.limits.high)


@pytest.mark.parametrize(("options", "words"), [
    ({"node_name": "bad-name"}, "Invalid node name: .*: 'bad-name'"),
    ({"namespace": "/a b"}, "Invalid namespace: .*: '/a b'"),
])
def test_a_name_that_is_none_is_told_in_one_line(options: dict[str, Any], words: str) -> None:
    context = Context()
    rclpy.init(context=context, domain_id=next_domain())
    with pytest.raises(InputError, match=f"^the node cannot be made: {words}$"):
        DeclaringNode("node", context=context, **options)
    context.shutdown()


def test_overrides_are_taken_and_judged(make_node: MakeNode) -> None:
    assert params.declare(make_node(stale_s=3, queue_depth=0), SETTINGS)["stale_s"] == 3.0
    with pytest.raises(ConfigError, match="exclude: is given an empty value"):
        make_node(exclude=None)
    with pytest.raises(ConfigError, match="queue_depth: 2 is out of range"):
        params.declare(make_node(queue_depth=2), SETTINGS)
    with pytest.raises(ConfigError, match=r"stale_s: True is a bool, it must be a float"):
        params.declare(make_node(stale_s=True), SETTINGS)
    with pytest.raises(ConfigError, match=r"image_transport: \['raw'\] is a list"):
        params.declare(make_node(image_transport=["raw"]), SETTINGS)


def test_bools_of_every_node_are_judged_before_rclpy_takes_them(
    make_node: MakeNode, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match=r"^use_sim_time: 5 is a int, it must be a bool$"):
        make_node(use_sim_time=5)
    with pytest.raises(ConfigError, match=r"^use_sim_time: 'yes please' is a str, it must be a bool$"):
        make_node(use_sim_time="yes please")
    with pytest.raises(ConfigError, match=r"^start_type_description_service: \[True\] is a list, it must be a bool$"):
        make_node(start_type_description_service=[True])
    assert capfd.readouterr().err == ""
    assert make_node(use_sim_time=True).get_parameter("use_sim_time").value


@pytest.mark.parametrize("name", ["", "a b", "/a//b", "/1a", "a/", "{other}/a", "é", "a" * 300])
def test_names_of_no_topic(make_node: MakeNode, name: str) -> None:
    with pytest.raises(InputError, match=r"^.* is no name of a topic, it must be as /camera/image_raw: .*\w") as told:
        params.topic_of(make_node(), name)
    assert "\n" not in str(told.value)
    assert params.topic_of(make_node(), "~/a") == "/node/a"


@pytest.mark.parametrize(("value", "names"), [(["/a", "b"], ["/a", "b"]), ("/a", ["/a"]), (None, [])])
def test_lists_of_names(make_node: MakeNode, value: list[str] | str | None, names: list[str]) -> None:
    node = make_node() if value is None else make_node(topics=value)
    assert params.declare_names(node, "topics", "what to record") == names
    assert node.describe_parameter("topics").description == "what to record"


def test_lists_of_something_else_are_refused(make_node: MakeNode) -> None:
    for value in (3, [1, 2], [True]):
        with pytest.raises(ConfigError, match=r"topics: .* must be a list of names"):
            params.declare_names(make_node(topics=value), "topics", "")


def test_refused_change_leaves_the_old_value(make_node: MakeNode) -> None:
    node = make_node()
    params.declare(node, PARAMETERS, changeable=PARAMETERS)
    taken: list[dict[str, Any]] = []

    def take(values: dict[str, Any]) -> None:
        if values.get("roi") == "nonsense":
            raise InputError("roi: nonsense")
        taken.append(values)

    params.ParameterUpdates(node, PARAMETERS, take)
    (refused,) = node.set_parameters([RosParameter("roi", value="nonsense")])
    assert (refused.successful, refused.reason) == (False, "roi: nonsense")
    assert node.get_parameter("roi").value == ""
    assert node.set_parameters_atomically([RosParameter("threshold", value=2), RosParameter("model", value="affine")])
    assert taken == [{"threshold": 2.0, "model": "affine"}]
    assert node.get_parameter("threshold").value == 2.0


def test_a_bool_is_taken_for_the_word_that_yaml_reads_so(make_node: MakeNode) -> None:
    node = make_node(rolling_shutter=False)
    assert params.declare(node, PARAMETERS, changeable=PARAMETERS)["rolling_shutter"] == "off"
    assert node.get_parameter("rolling_shutter").value == "off"
    taken: list[dict[str, Any]] = []
    params.ParameterUpdates(node, PARAMETERS, taken.append)
    assert node.set_parameters_atomically([RosParameter("rolling_shutter", value="auto")]).successful
    assert node.set_parameters_atomically([RosParameter("rolling_shutter", value=False)]).successful
    assert [values["rolling_shutter"] for values in taken] == ["auto", "off"]
    for name, wrong in (("rolling_shutter", True), ("model", False), ("threshold", False)):
        before = node.get_parameter(name).value
        (refused,) = node.set_parameters([RosParameter(name, value=wrong)])
        assert not refused.successful
        assert node.get_parameter(name).value == before
    assert len(taken) == 2
