"""The pure parts of the nodes, and their ROS parts as far as they need no second process."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from hypothesis import given
from hypothesis import strategies as st
from live_graph import next_domain
from rclpy.context import Context
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from stab_ros.core.errors import ConfigError, InputError, WorkError
from stab_ros.core.types import State, Track
from stab_ros.nodes import params, qos
from stab_ros.nodes.free_time import FreeTime
from stab_ros.nodes.gap_counter import GapCounter
from stab_ros.nodes.runtime import message_class
from stab_ros.nodes.schedule import Schedule
from stab_ros.nodes.silence import Silence
from stab_ros.nodes.stopping import StopRequest, node_main, until_stopped
from stab_ros.nodes.tracker_node import SETTINGS
from stab_ros.nodes.tracker_status import TrackerStatus
from stab_ros.parameters.table import PARAMETERS

SECOND_NS = 10**9
RELIABLE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Node]]:
    """Nodes with these parameters given, as on a command line."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = Context()
    rclpy.init(context=context, domain_id=next_domain())
    nodes: list[Node] = []

    def make(**given_values: Any) -> Node:
        overrides = [RosParameter(name, value=value) for name, value in given_values.items()]
        nodes.append(rclpy.create_node("node", context=context, parameter_overrides=overrides,
                                       automatically_declare_parameters_from_overrides=True))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    context.shutdown()


# gaps and pace


@given(st.lists(st.integers(1, 5), min_size=1))
def test_gaps_add_up(steps: list[int]) -> None:
    counter = GapCounter()
    numbers = np.cumsum(steps).tolist()
    missed = sum(counter.missed(number) for number in numbers)
    assert missed == numbers[-1] - numbers[0] + 1 - len(numbers)


def test_gaps_of_another_publisher_are_not_counted() -> None:
    counter = GapCounter()
    assert [counter.missed(number) for number in (1000, 1002, 1, 2, 5)] == [0, 1, 0, 0, 2]
    assert counter.missed(99, publishers=2) == 0


def test_schedule_plays_faster_and_slower() -> None:
    fast = Schedule(bag_start_ns=100 * SECOND_NS, start_ns=7 * SECOND_NS, rate=4.0)
    assert fast.due_ns(108 * SECOND_NS) == 9 * SECOND_NS
    assert fast.bag_time_ns(9 * SECOND_NS) == 108 * SECOND_NS
    assert Schedule(0, 0, 0.5).due_ns(SECOND_NS) == 2 * SECOND_NS


def test_schedule_goes_on_after_a_stall() -> None:
    stalled = Schedule(0, 0, 2.0).resumed(5 * SECOND_NS)
    assert stalled.due_ns(4 * SECOND_NS) == 7 * SECOND_NS
    assert stalled.bag_time_ns(7 * SECOND_NS) == 4 * SECOND_NS


# free time and silence


def test_time_is_free_only_while_nothing_is_to_be_done() -> None:
    free = FreeTime()
    free.waited(3, 10)
    free.waited(5_000, 10)  # the process was stopped, or got no CPU
    free.waited(-1, 10)
    assert free.ns == 13


def test_timers_stand_for_waits_where_nobody_tells_of_any() -> None:
    free = FreeTime()
    free.ticked(100)
    assert free.ns == 100
    free.waited(7, 10)
    free.ticked(100)
    assert free.ns == 107


def test_silence_of_a_stream() -> None:
    silence = Silence(stale_ns=2 * SECOND_NS)
    assert not silence.begun
    assert (silence.ns(9 * SECOND_NS), silence.is_stale(9 * SECOND_NS)) == (0, False)  # none before the first image
    assert silence.broken(9 * SECOND_NS) == 0
    assert (silence.is_stale(11 * SECOND_NS), silence.is_stale(11 * SECOND_NS + 1)) == (False, True)
    assert (silence.is_lasting(19 * SECOND_NS), silence.is_lasting(19 * SECOND_NS + 1)) == (False, True)


def test_a_slow_stream_is_given_more_time() -> None:
    silence = Silence(stale_ns=2 * SECOND_NS)
    for at_s in (0, 26, 52):
        silence.broken(at_s * SECOND_NS)
    assert not silence.is_lasting((52 + 78) * SECOND_NS)
    assert silence.is_lasting((52 + 78) * SECOND_NS + 1)
    silence.broken(53 * SECOND_NS)  # as quick as others again
    assert silence.is_lasting((53 + 10) * SECOND_NS + 1)


# what the tracker says of itself


def a_track(state: State, number: int = 0) -> Track:
    if state is State.LOST:
        return Track(state, number, number, 0, 0, matches=40)
    return Track(state, number, number, 0, 0, 50, 45, np.eye(3), np.eye(8), 0.25, 0.125)


def test_status_counts_what_happens() -> None:
    status = TrackerStatus("direct", stale_ns=2 * SECOND_NS)
    status.waiting_for = "images on /image_raw"
    before = status.report(0)
    assert (before.level, before.message, before.values["state"]) == (1, "waiting for images on /image_raw", "WAITING")
    status.on_image(SECOND_NS)
    status.on_track(a_track(State.TRACKED), latency_ns=12_345_678)
    status.on_dropped(3)
    report = status.report(2 * SECOND_NS)
    assert (report.level, report.message) == (0, "tracked")
    assert report.values == {
        "state": "TRACKED", "method": "direct", "frames_in": "1", "frames_tracked": "1", "frames_lost": "0",
        "frames_dropped": "3", "frames_refused": "0", "frames_before": "0", "matches": "50", "inliers": "45",
        "rmse_px": "0.25", "sigma_px": "0.125", "latency_ms": "12.346", "reset_counter": "0", "ground": "undecided",
        "rival_share": "", "parallax_px": "", "parallax_deg": "",
    }


def test_status_of_lost_refused_and_missing_frames() -> None:
    status = TrackerStatus("klt", stale_ns=2 * SECOND_NS)
    status.on_image(0)
    status.on_track(a_track(State.LOST), latency_ns=1)
    status.on_refused()
    status.remark("refused", "refused an image: step 0")
    status.remark("refused", "refused an image: step is too short")
    report = status.report(SECOND_NS)
    assert (report.level, report.message) == (1, "lost; refused an image: step is too short")
    assert (report.values["rmse_px"], report.values["frames_in"], report.values["frames_lost"]) == ("", "2", "1")
    stale = status.report(5 * SECOND_NS)
    assert (stale.level, stale.message, stale.values["state"]) == (2, "no image for 5.0 s", "STALE")


# quality of service


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


# parameters


def test_all_parameters_are_declared_with_their_meaning_and_range(make_node: Callable[..., Node]) -> None:
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


def test_overrides_are_taken_and_judged(make_node: Callable[..., Node]) -> None:
    assert params.declare(make_node(stale_s=3, queue_depth=0), SETTINGS)["stale_s"] == 3.0
    with pytest.raises(ConfigError, match="queue_depth: 2 is out of range"):
        params.declare(make_node(queue_depth=2), SETTINGS)
    with pytest.raises(ConfigError, match=r"stale_s: True is a bool, it must be a float"):
        params.declare(make_node(stale_s=True), SETTINGS)
    with pytest.raises(ConfigError, match=r"image_transport: \['raw'\] is a list"):
        params.declare(make_node(image_transport=["raw"]), SETTINGS)


@pytest.mark.parametrize(("value", "names"), [(["/a", "b"], ["/a", "b"]), ("/a", ["/a"]), (None, [])])
def test_lists_of_names(make_node: Callable[..., Node], value: list[str] | str | None, names: list[str]) -> None:
    node = make_node() if value is None else make_node(topics=value)
    assert params.declare_names(node, "topics", "what to record") == names
    assert node.describe_parameter("topics").description == "what to record"


def test_lists_of_something_else_are_refused(make_node: Callable[..., Node]) -> None:
    for value in (3, [1, 2], [True]):
        with pytest.raises(ConfigError, match=r"topics: .* must be a list of names"):
            params.declare_names(make_node(topics=value), "topics", "")


def test_refused_change_leaves_the_old_value(make_node: Callable[..., Node]) -> None:
    node = make_node()
    params.declare(node, PARAMETERS, changeable=PARAMETERS)
    taken: list[dict[str, Any]] = []

    def take(values: dict[str, Any]) -> None:
        if values.get("roi") == "nonsense":
            raise InputError("roi: nonsense")
        taken.append(values)

    params.LiveChanges(node, PARAMETERS, take)
    (refused,) = node.set_parameters([RosParameter("roi", value="nonsense")])
    assert (refused.successful, refused.reason) == (False, "roi: nonsense")
    assert node.get_parameter("roi").value == ""
    assert node.set_parameters_atomically([RosParameter("threshold", value=2), RosParameter("model", value="affine")])
    assert taken == [{"threshold": 2.0, "model": "affine"}]
    assert node.get_parameter("threshold").value == 2.0
    with pytest.raises(ParameterNotDeclaredException):
        node.set_parameters([RosParameter("nonsense", value=1)])


# processes


def test_types_by_name() -> None:
    assert message_class("std_msgs/msg/String").__name__ == "String"
    for unknown in ("std_msgs/msg/Nothing", "nobody_msgs/msg/String"):
        with pytest.raises(InputError, match="is not installed"):
            message_class(unknown)
    for nonsense in ("String", "", "std_msgs/srv/String", "os.path/msg/join"):
        with pytest.raises(InputError, match="is no message type"):
            message_class(nonsense)


@pytest.fixture
def handlers() -> Iterator[None]:
    """Puts the test runner's own signal handlers back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_interrupt_the_start_but_not_the_work(number: int) -> None:
    finished: list[bool] = []

    def start(_stop: StopRequest) -> int:
        signal.raise_signal(number)
        raise AssertionError("the start was not interrupted")

    def work(stop: StopRequest) -> int:
        stop.defer()
        signal.raise_signal(number)
        signal.raise_signal(number)
        finished.append(stop.requested)
        return 5

    assert until_stopped(start) == 0
    assert until_stopped(work) == 5
    assert finished == [True]
    signal.raise_signal(number)  # has no effect any more


@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize(("error", "code"), [(InputError("bag: missing"), 2), (WorkError("disk full"), 1)])
def test_errors_are_one_line(error: Exception, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(_stop: StopRequest) -> int:
        raise error

    assert node_main("some_node", fail) == code
    assert capsys.readouterr().err == f"some_node: {error}\n"
