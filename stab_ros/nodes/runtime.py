"""How the process of a node starts, spins and ends; the base class of the nodes."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.kernels import Compilation
from stab_ros.core.memory import keep_freed_memory
from stab_ros.io.diagnostics_message import WARN, diagnostics_cdr
from stab_ros.io.installed_types import python_folders
from stab_ros.io.topics import DIAGNOSTICS_TOPIC
from stab_ros.jobs.compiling import not_kept
from stab_ros.nodes import log_folder
from stab_ros.nodes.background_compilation import BackgroundCompilation
from stab_ros.nodes.diagnostic_status import DiagnosticStatus
from stab_ros.nodes.free_time import FreeTime
from stab_ros.nodes.node_options import NodeOptions
from stab_ros.nodes.spinner import Spinner
from stab_ros.nodes.stopping import StopRequest, end_at_once
from stab_ros.nodes.transport import use_profile

if TYPE_CHECKING:
    from typing_extensions import Unpack

_START_S = 0.1  # period at which a node in an executor of somebody else looks whether it can begin
_NO_CLOCK = "use_sim_time is set, but nobody publishes /clock; the time is zero until somebody does"


class StabNode(Node):
    """A node with diagnostics, steady timers, and parameters that may be given to the constructor.

    `run` drives it. In an executor of somebody else it compiles and prepares itself as soon as that spins.

    stop: whether the node is to end; long waits check it. free: the time in which the node had nothing to do.
    """

    COMPUTES: ClassVar[bool] = False  # whether it uses kernels, which are then compiled before `prepare`
    COMPOSABLE: ClassVar[bool] = True  # whether callbacks do its work, so that any executor can spin it

    def __init__(self, name: str, given: Mapping[str, Any] | None = None, **options: Unpack[NodeOptions]) -> None:
        options.setdefault("node_name", name)
        options["parameter_overrides"] = [*options.get("parameter_overrides", []),
                                          *(Parameter(key, value=value) for key, value in (given or {}).items())]
        try:  # the overrides are declared as they come, so that `params.declare` can judge them
            super().__init__(automatically_declare_parameters_from_overrides=True, **options)
        except ValueError as error:
            raise ConfigError(f"a parameter was given an empty value, it must be left out instead ({error})") from error
        except RuntimeError as error:  # rclpy's RCLError, as where security is asked for and cannot be had
            raise InputError(f"the node cannot be made: {str(error).split(', at ')[0]}") from error
        self.stop, self.free = StopRequest(), FreeTime()
        self._diagnostics: Publisher = self.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, 10)
        self._compilation: BackgroundCompilation | None = None
        self.own_start = self.create_steady_timer(_START_S, self._start)

    def on_compilation(self, progress: Compilation) -> None:
        """Called repeatedly while kernels are compiled."""

    def prepare(self) -> None:
        """Called once before `work`, or once an executor of somebody else spins; takes part from then on."""
        self.own_start.cancel()

    def _start(self) -> None:
        """What `run` does else: the executor that calls this is not ours. Others' callbacks do not wait meanwhile."""
        if not self.COMPOSABLE:
            self.own_start.cancel()
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
            _log_compilation(self.get_logger(), self._compilation)
        return self._compilation.done

    def on_failure(self, error: BaseException) -> None:
        """An error has escaped a callback; raised again, it ends the node."""
        raise error

    def work(self, spinner: Spinner) -> None:
        """The main loop; returns when `spinner.stopping`, or when there is nothing left to do."""
        while not spinner.stopping:
            spinner.once()

    def create_steady_timer(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """A timer on the monotonic clock, which runs also while simulated time stands still."""
        return self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish_diagnostics(self, status: DiagnosticStatus) -> None:
        """One status on /diagnostics, named as the node and with its namespace as hardware_id."""
        level, message = status.level, status.message
        now_ns = self.get_clock().now().nanoseconds
        if now_ns == 0:  # only a simulated clock can stand there
            level, message = max(level, WARN), f"{message}; {_NO_CLOCK}"
            self.get_logger().warning(_NO_CLOCK, once=True)
        name = self.get_fully_qualified_name().lstrip("/")
        self._diagnostics.publish(diagnostics_cdr(now_ns, name, self.get_namespace(), level, message, status.values))

    def flush_diagnostics(self) -> None:
        """Waits until subscribers have acknowledged the last report, at most 1 s."""
        self._diagnostics.wait_for_all_acked(Duration(seconds=1))


def run(make: Callable[[], StabNode], stop: StopRequest) -> int:
    """Runs a node from start to end; exit code 0.

    Raises:
        InputError: bad ROS arguments or parameters. WorkError: the node's work broke off.
    """
    stop.defer()  # an exception in the middle of rclpy or of a destructor would be lost or leave a trace
    keep_freed_memory()
    warnings = [use_profile(), _init()]
    compilation: BackgroundCompilation | None = None
    try:
        node = make()
        node.stop = stop
        for warning in filter(None, warnings):
            node.get_logger().warning(warning)
        compilation = BackgroundCompilation() if node.COMPUTES else None
        _spin(node, stop, compilation)
    finally:
        rclpy.try_shutdown()
    if compilation is not None and not compilation.done:
        end_at_once()
    return 0


def _spin(node: StabNode, stop: StopRequest, compilation: BackgroundCompilation | None) -> None:
    node.own_start.cancel()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        spinner = Spinner(executor, stop, node.free, node.on_failure)
        if compilation is not None:
            _compile(node, spinner, compilation)
        if not spinner.stopping:
            node.prepare()
            node.work(spinner)
    finally:
        executor.shutdown()
        node.destroy_node()


def _compile(node: StabNode, spinner: Spinner, compilation: BackgroundCompilation) -> None:
    """Spins the node until its kernels are compiled; logs it unless all were found in the cache."""
    log, logged = node.get_logger(), False
    while not (compilation.done or spinner.stopping):
        node.on_compilation(compilation.progress)
        if compilation.progress.compiled and not logged:
            logged = True
            log.info("compiling kernels, once after an installation; no images are taken until that is done")
        spinner.once()
    if compilation.done:
        _log_compilation(log, compilation)


def _log_compilation(log: RcutilsLogger, compilation: BackgroundCompilation) -> None:
    result = compilation.result
    if result.compiled:
        log.info(f"compiled {result.compiled} of {result.total} kernels in {compilation.age_s:.1f} s")
    if result.trouble:
        log.warning(not_kept(result.trouble))


def _init() -> str:
    """Initialises rclpy; returns a warning, "" for none."""
    set_logger_level("rcl", LoggingSeverity.FATAL)  # rcl would print its own line beside ours
    warning = log_folder.problem(os.environ)
    try:
        rclpy.init(args=[*sys.argv, *(log_folder.NO_LOG_FILE if warning else ())],
                   signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rclpy's RCLError is not public
        raise InputError(f"the ROS arguments cannot be used: {str(error).split(', at ')[0]}") from error
    set_logger_level("rcl", LoggingSeverity.UNSET)
    return warning


def message_class(msgtype: str) -> Any:
    """The class of a message type such as `sensor_msgs/msg/Image`.

    Raises:
        InputError: it is not installed.
    """
    named = re.fullmatch(r"(\w+)/msg/(\w+)", msgtype)
    if named is None:
        raise InputError(f"{msgtype!r} is no message type, it must be named as package/msg/Name")
    missing = InputError(f"message type {msgtype} is not installed; install {named[1]} (apt: ros-jazzy-"
                         f"{named[1].replace('_', '-')}) or source the workspace that holds it, then start again")
    if not _holds_messages(named[1]):  # a bag may name any module, and importing it runs it
        raise missing
    try:
        return getattr(importlib.import_module(f"{named[1]}.msg"), named[2])
    except (ImportError, AttributeError) as error:
        raise missing from error


def _holds_messages(package: str) -> bool:
    """Whether an installed package looks like one of messages; it is not imported."""
    return any((place / "msg" / "__init__.py").is_file() for place in python_folders(package))
