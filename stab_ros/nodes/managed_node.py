"""A managed node (ROS 2 lifecycle): the base class of the nodes, and what the states mean to them.

| state | what there is |
|---|---|
| unconfigured | the node, its lifecycle services and /diagnostics; parameters may be set |
| inactive | checked parameters, compiled kernels, publishers; no images are taken; a reference is kept |
| active | images are taken |

By default a node configures and activates itself (`autostart`). What `configure` made, entities and attributes, goes
with `cleanup`; what `activate` made, with `deactivate`.

Callbacks are of two groups. Those of the default group, which take messages and change the node, exclude each other.
Those of `at_once` only read, or leave a note: they may run beside the others, and do so in the process of our own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from stab_ros.core.errors import StabRosError, WorkError
from stab_ros.core.kernels import Compilation, compile_kernels
from stab_ros.io.cdr import SECOND_NS
from stab_ros.io.diagnostics_message import OK, WARN, diagnostics_cdr
from stab_ros.io.topics import DIAGNOSTICS_TOPIC
from stab_ros.nodes import params
from stab_ros.nodes.background_compilation import BackgroundCompilation
from stab_ros.nodes.diagnostic_status import DiagnosticStatus
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.free_time import FreeTime
from stab_ros.nodes.namesakes import Namesakes
from stab_ros.nodes.qos_overrides import PREFIX, check_overrides, overridden, unused_overrides
from stab_ros.nodes.spinner import Spinner
from stab_ros.nodes.stopping import StopRequest
from stab_ros.parameters.node_settings import ManagedSettings

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.image_source import ImageSource
    from stab_ros.nodes.node_options import RosOptions

_NO_CLOCK = "use_sim_time is set, but nobody publishes /clock; the time is zero until somebody does"
_UNUSED_NS = 5 * SECOND_NS  # of free time while active, after which it is told that nothing uses an override of QoS
_POLL_NS = SECOND_NS // 10
_REPORT_S = 1.0
_LATE_S, _LONG_S = 1.5, 5.0  # after which a report that is due is repeated, and what is at work told
# the services of rclpy that change nothing of the work
_READING = {"describe_parameters", "get_parameters", "get_parameter_types", "list_parameters",
            "get_state", "get_available_states", "get_available_transitions", "get_transition_graph",
            "get_logger_levels", "set_logger_levels"}
_DONE = {"configure": "configured", "activate": "activated", "deactivate": "deactivated", "clean up": "cleaned up",
         "shut down": "shut down", "recover": "everything is let go, after an error"}
_KINDS = ("timer", "subscription", "service", "client", "publisher")  # of entities, in the order they are destroyed


class StabNode(LifecycleNodeMixin, params.DeclaringNode):
    """A managed node with diagnostics, steady timers, and parameters that may be given to the constructor.

    Subclasses say what `configure`, `activate`, `deactivate`, `poll` and `report` do. Where one of the first three
    raises a StabRosError, the node goes back to the state before.

    Attributes:
        stop: whether the node is to end; long waits check it.
        at_once: the group of callbacks that may run while others do: they only read, or leave a note.
        free: the time in which the node had nothing to do.
        is_configured: whether it is inactive or active.
        is_active: whether it takes images.
        waits: whether it activates itself only when told to, and not at the first spin.
        images: who takes images for it; None: nobody else does.
        on_settled: called once a second while it `is_settled`.
    """

    COMPUTES: ClassVar[bool] = False  # whether it uses kernels, which are compiled before it takes images
    TAKES_IMAGES: ClassVar[bool] = False  # whether it asks `images` for them
    COMPOSABLE: ClassVar[bool] = True  # whether callbacks do its work, so that any executor can spin it

    def __init__(self, name: str, given: Mapping[str, Any] | None = None, images: ImageSource | None = None,
                 **options: Unpack[RosOptions]) -> None:
        """Makes the node, and configures it unless `autostart` is false.

        Args:
            name: of the node, unless it is remapped.
            given: parameters that are overridden.
            images: see the attribute.
            options: as of rclpy's node; the services of logger levels are there unless they are declined.

        Raises:
            InputError: a parameter cannot be used.
        """
        options.setdefault("enable_logger_service", True)
        self.on_settled: Callable[[], None] = lambda: None
        self._declared = ""  # the parameter that is being declared; callbacks hear of it as if somebody had set it
        params.DeclaringNode.__init__(self, name, given, **options)
        LifecycleNodeMixin.__init__(self)
        self._refuse_impossible_transitions()
        self.stop, self.free, self.images = StopRequest(), FreeTime(), images
        self.others = () if images is None else images.parameters
        self.at_once: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._read_at_once()
        self.is_configured = self.is_active = self.waits = False
        self._compilation: BackgroundCompilation | None = None  # in an executor of somebody else
        self._refusal: StabRosError | None = None  # of the last transition
        self._brings_up = self._told = False  # a transition of its own is under way; the present one has been told
        self._unforeseen = Failures(self.get_logger())  # in callbacks while it is not configured
        self._closing: list[Callable[[], None]] = []
        self._namesakes = Namesakes(self, "" if images is None else options.get("node_name", name))
        self._before = _Made(self)  # what there was before `configure`
        self._doubted: set[str] = set()  # overrides of QoS of which something was said
        self._check_overrides()
        topic = self.resolve_topic_name(DIAGNOSTICS_TOPIC)
        qos, overriding = overridden(self, "publisher", topic, QoSProfile(depth=10))
        self._diagnostics: Publisher = self.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, qos,
                                                             qos_overriding_options=overriding)
        self._activated_ns = 0  # in free time
        self.create_steady_timer(_REPORT_S, self._tell_unused)
        self.autostart = self._starts = bool(params.declare(self, params.table_of(ManagedSettings))["autostart"])
        self.add_on_set_parameters_callback(self._refuse_idle_changes)
        self._reported = time.monotonic(), DiagnosticStatus(OK, "", {})  # when, s, and the last report
        self._spun_s = math.inf  # since when somebody spins it, monotonic
        self.create_steady_timer(_REPORT_S, self._report_state)
        self.create_steady_timer(_REPORT_S, self._report_again, self.at_once)
        self.create_steady_timer(_POLL_NS / SECOND_NS, self._poll_if_active)
        if self.autostart:
            self._bring_up(self.trigger_configure)
        if images is not None and self.TAKES_IMAGES:
            images.expect(self.get_fully_qualified_name())

    # what subclasses do ----------------------------------------------------------------------------------------------
    def configure(self) -> None:
        """Declares and checks everything. What it makes, attributes too, goes with `cleanup`."""

    def activate(self) -> None:
        """Begins to take images."""

    def deactivate(self) -> None:
        """Ends taking images; what is known stays."""

    def poll(self) -> None:
        """Follows the other nodes; called ten times a second while active."""

    def report(self) -> None:
        """Publishes the diagnostics; called once a second once configured."""

    def on_compilation(self, progress: Compilation) -> None:
        """Called repeatedly while kernels are compiled, once configured."""

    def flush(self) -> None:
        """Waits until what was sent has been received; called before the outputs go."""

    def on_failure(self, error: BaseException) -> None:
        """An error has escaped a callback, once configured; raised again, it ends the node."""
        raise error

    def work(self, spinner: Spinner) -> None:
        """The main loop; returns when `spinner.stopping`, or when there is nothing left to do."""
        while not spinner.stopping:
            spinner.once()

    # what they use ---------------------------------------------------------------------------------------------------
    @property
    def is_paused(self) -> bool:
        """Whether it takes no images until somebody activates it: that none come is no fault."""
        return not (self.is_active or self._starts)

    @property
    def is_settled(self) -> bool:
        """Whether it has been active for some time, in which it has made its publishers and subscriptions."""
        return self.is_active and self.free.ns - self._activated_ns >= _UNUSED_NS

    def tell(self, line: str) -> None:
        """Logs what a change of state has led to, instead of the change alone."""
        self._told = True
        self.get_logger().info(line)

    def at_cleanup(self, close: Callable[[], None]) -> None:
        """Has `close` called when what `configure` made is let go, the last one first."""
        self._closing.append(close)

    def create_steady_timer(self, period_s: float, callback: Callable[[], None],
                            group: CallbackGroup | None = None) -> None:
        """A timer on the monotonic clock, which runs also while simulated time stands still."""
        self.create_timer(period_s, callback, group, Clock(clock_type=ClockType.STEADY_TIME))

    def publish_diagnostics(self, status: DiagnosticStatus) -> None:
        """One status on /diagnostics, named as the node and with its namespace as hardware_id.

        While nobody has activated the node, it is told without the faults of the stream.
        """
        status = status.while_inactive() if self.is_paused else status
        self._reported = time.monotonic(), status
        self._send_diagnostics(status)

    def _send_diagnostics(self, status: DiagnosticStatus) -> None:
        level, message, state = status.level, status.message, self._state_machine.current_state[1]
        if state != "active" and not self._starts:
            message = f"{state}: {message}" if level != OK else state
        if self._refusal is not None and self.is_configured:
            level, message = max(level, WARN), f"{message}; {self._refusal}"
        now_ns = self.get_clock().now().nanoseconds
        if now_ns == 0:  # only a simulated clock can stand there
            level, message = max(level, WARN), f"{message}; {_NO_CLOCK}"
            self.get_logger().warning(_NO_CLOCK, once=True)
        if self._namesakes.problem:
            level, message = max(level, WARN), f"{message}; {self._namesakes.problem}"
        name, values = self.get_fully_qualified_name().lstrip("/"), {**status.values, "lifecycle": state}
        self._diagnostics.publish(diagnostics_cdr(now_ns, name, self.get_namespace(), level, message, values))

    def flush_diagnostics(self) -> None:
        """Waits until subscribers have acknowledged the last report, at most 1 s."""
        self._diagnostics.wait_for_all_acked(Duration(seconds=1))

    def end(self) -> None:
        """Lets go of everything, at the end of the process.

        Raises:
            WorkError: what was written cannot be completed.
        """
        self._let_go()

    def destroy_node(self) -> None:
        """Also lets go of the state machine, which would keep the node in the graph, and its shared memory."""
        super().destroy_node()
        del self._state_machine

    def on_escaped(self, error: BaseException) -> None:
        """An error has escaped a callback; while the node is not configured it is only logged."""
        if self.is_configured or not isinstance(error, Exception):
            self.on_failure(error)
        else:
            self._unforeseen.note(error)

    def prepare(self) -> None:
        """Activates the node at once rather than at its first spin; compiles its kernels if that is still to be done.

        Raises:
            StabRosError: it cannot take images.
        """
        self._starts = False
        self._bring_up(self.trigger_activate)

    # transitions -----------------------------------------------------------------------------------------------------
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._before = _Made(self)
        self._reported = time.monotonic(), DiagnosticStatus(OK, "", {})  # a reason of before is mended, as far as known
        return self._attempt("configure", self._configure, self._let_go)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt("activate", self._activate, self._pause)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt("deactivate", self._pause, self._pause)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        left = self._attempt("clean up", self._let_go, self._let_go)
        return left if left == TransitionCallbackReturn.SUCCESS else TransitionCallbackReturn.ERROR  # all is gone

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.stop.requested = True
        return self._attempt("shut down", self._shut_down, self._let_go)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After an error that nobody foresaw: everything is let go."""
        reason = self._refusal
        left = self._attempt("recover", self._shut_down, self._let_go)
        self._refusal = self._refusal or reason
        return left

    def _read_at_once(self) -> None:
        """Has what only reads answered while the node works."""
        for service in self.services:
            if service.srv_name.rpartition("/")[2] in _READING:
                service.callback_group = self.at_once
                self.at_once.add_entity(service)

    def _refuse_impossible_transitions(self) -> None:
        """As rclpy answers those by an exception, which would end the node."""
        service = next(one for one in self.services if one.srv_type is ChangeState)  # whatever its name is
        change = service.callback

        def change_if_possible(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
            wanted, state = request.transition, self._state_machine.current_state[1]
            possible = [(number, label) for number, label, *_ in self._state_machine.available_transitions]
            if any(wanted.label == label if wanted.label else wanted.id == number for number, label in possible):
                return change(request, response)
            self.get_logger().warning(f"transition {wanted.label or wanted.id} is refused: the node is {state}, where "
                                      f"there are {', '.join(label for _, label in possible) or 'none'}")
            response.success = False
            return response

        service.callback = change_if_possible

    def _configure(self) -> None:
        self._check_overrides()
        self.configure()
        if self.COMPUTES and not self.autostart:  # else the process compiles them beside, before the first spin
            compile_kernels()
        self.is_configured = True

    def _activate(self) -> None:
        if self.COMPUTES:  # at once if that is done; somebody may ask for the state before
            compile_kernels()
        self.activate()
        self.is_active, self._activated_ns = True, self.free.ns
        self.poll()

    def _pause(self) -> None:
        self.is_active = False
        self.deactivate()

    def _shut_down(self) -> None:
        if self.is_active:
            self._pause()
        self._let_go()

    def _let_go(self) -> None:
        if self.is_configured:
            self.flush()
        self.is_configured = False
        while self._closing:
            self._closing.pop()()
        self._before.restore(self)

    def _attempt(self, what: str, step: Callable[[], None], undo: Callable[[], None]) -> TransitionCallbackReturn:
        """What becomes of the transition `what`, whose work is `step`; `undo`: where it fails."""
        failures, self._refusal, self._told = Failures(self.get_logger()), None, False
        with failures:
            try:
                step()
            except StabRosError as error:
                self._refuse(what, error)
                undo()
                return TransitionCallbackReturn.FAILURE
            if not (self._brings_up or self._told):
                self.get_logger().info(_DONE[what])
            return TransitionCallbackReturn.SUCCESS
        self._refusal = WorkError(failures.last)
        return TransitionCallbackReturn.ERROR

    def _refuse(self, what: str, error: StabRosError) -> None:
        """Why the transition fails; where the node brings itself up, the line with which its process ends says it."""
        self._refusal = error
        if not self._brings_up:
            self.get_logger().error(f"cannot {what}: {error}")

    def _bring_up(self, trigger: Callable[[], TransitionCallbackReturn]) -> None:
        self._brings_up = True
        try:
            done = trigger() == TransitionCallbackReturn.SUCCESS
        finally:
            self._brings_up = False
        if not done and self._refusal is not None:
            raise self._refusal

    # timers and parameters -------------------------------------------------------------------------------------------
    def _poll_if_active(self) -> None:
        if self.is_active:
            self.free.ticked(_POLL_NS)
            self.poll()
        elif self._starts and not self.waits:
            self._start()

    def _start(self) -> None:
        """What `run` does else: the executor that calls this is not ours. Others' callbacks do not wait meanwhile."""
        if not self.COMPOSABLE:
            self._starts = False
            self.get_logger().error("does nothing in an executor of another program, as its work is a loop of its "
                                    "own; start its executable instead")
        elif self._is_compiled():
            self.prepare()

    def _is_compiled(self) -> bool:
        if not self.COMPUTES:
            return True
        if self._compilation is None:
            self._compilation = BackgroundCompilation()
        self.on_compilation(self._compilation.progress)
        if self._compilation.done:
            self._compilation.tell(self.get_logger())
        return self._compilation.done

    def _report_state(self) -> None:
        self._namesakes.look()
        if self.is_configured:
            self.report()
        else:
            level = OK if self._refusal is None else WARN
            self.publish_diagnostics(DiagnosticStatus(level, str(self._refusal or ""), {}))

    def _report_again(self) -> None:
        """The last report once more while something takes so long that the next one is late, and what is the matter."""
        (then_s, last), now_s = self._reported, time.monotonic()
        self._spun_s = min(self._spun_s, now_s)  # before the first call, nobody was at work
        late_s = now_s - max(then_s, self._spun_s)
        if late_s > _LONG_S:
            message = "; ".join(filter(None, [last.message, f"at work on one step for {late_s:.0f} s"]))
            self._send_diagnostics(DiagnosticStatus(max(last.level, WARN), message, last.values))
        elif late_s > _LATE_S:
            self._send_diagnostics(last)

    def _check_overrides(self) -> None:
        """Also of subscriptions that come later. Raises ConfigError for one that is no quality of service."""
        for line in check_overrides(self):
            if line not in self._doubted:
                self._doubted.add(line)
                self.get_logger().warning(line)

    def _tell_unused(self) -> None:
        """What was meant for a publisher or subscription that is not there; some come later than others."""
        if not self.is_settled:
            return
        self.on_settled()
        for name, line in unused_overrides(self).items():
            if name not in self._doubted and not (self.images is not None and self.images.is_used(name)):
                self._doubted.add(name)
                self.get_logger().warning(line)

    def declare_parameter(self, name: str, *args: Any, **options: Any) -> Parameter:
        """Also called by rclpy, for the quality of service of what begins to be published or taken."""
        self._declared = name
        try:
            return super().declare_parameter(name, *args, **options)
        finally:
            self._declared = ""

    def _refuse_idle_changes(self, changed: list[Parameter]) -> SetParametersResult:
        """Once configured, other parameters than those that are declared have no effect, nor have some changes."""
        for one in changed if self.is_configured else []:
            if one.type_ is Parameter.Type.NOT_SET:
                return SetParametersResult(successful=False, reason=f"{one.name} cannot be taken away, set it instead")
            if one.name in self.fixed or (one.name.startswith(PREFIX) and one.name != self._declared):
                return SetParametersResult(successful=False, reason=f"{one.name} is fixed while the node is "
                                           "configured, set it after cleanup")
            if not (self.has_parameter(one.name) or one.name == self._declared):
                known = list(self.get_parameters_by_prefix(""))
                return SetParametersResult(successful=False, reason=params.unknown(one.name, known))
        return SetParametersResult(successful=True)


class _Made:
    """The entities and attributes that a node has at a time, to get rid of those that come later."""

    def __init__(self, node: Node) -> None:
        self._entities = {kind: list(getattr(node, f"{kind}s")) for kind in _KINDS}
        self._attributes = set(vars(node)) | {"_before"}

    def restore(self, node: Node) -> None:
        """Destroys what the node has made since."""
        for kind in _KINDS:
            for entity in list(getattr(node, f"{kind}s")):
                if not any(entity is one for one in self._entities[kind]):
                    getattr(node, f"destroy_{kind}")(entity)
        for name in set(vars(node)) - self._attributes:
            delattr(node, name)
