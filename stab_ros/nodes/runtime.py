"""How the process of a node starts, spins and ends; the base class of the nodes."""

from __future__ import annotations

import importlib
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

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
from stab_ros.nodes.nested_lists import with_lists_as_text
from stab_ros.nodes.parameter_files import files_for_others
from stab_ros.nodes.qos_overrides import check_overrides, overridden, unused_overrides
from stab_ros.nodes.spinner import Spinner
from stab_ros.nodes.stopping import StopRequest, end_at_once
from stab_ros.nodes.transport import use_profile

_UNUSED_S = 5.0  # after which it is told that nothing uses an override of a quality of service
_SIM_TIME = "Whether the time of diagnostics and recordings is that of /clock; results are timed by header stamps"
_NO_CLOCK = "use_sim_time is set, but nobody publishes /clock; the time is zero until somebody does"


class StabNode(Node):
    """A node with diagnostics, steady timers, and parameters that may be given to the constructor.

    stop: whether the node is to end; long waits check it. free: the time in which the node had nothing to do.
    """

    COMPUTES: ClassVar[bool] = False  # whether it uses kernels, which are then compiled before `prepare`

    def __init__(self, name: str, given: Mapping[str, Any] | None = None) -> None:
        overrides = [Parameter(key, value=value) for key, value in (given or {}).items()]
        try:  # the overrides are declared as they come, so that `params.declare` can judge them
            super().__init__(name, automatically_declare_parameters_from_overrides=True, parameter_overrides=overrides)
        except ValueError as error:
            raise ConfigError(f"a parameter was given an empty value, it must be left out instead ({error})") from error
        except RuntimeError as error:  # rclpy's RCLError, as where security is asked for and cannot be had
            raise InputError(f"the node cannot be made: {str(error).split(', at ')[0]}") from error
        self.set_descriptor("use_sim_time",
                            ParameterDescriptor(type=ParameterType.PARAMETER_BOOL, description=_SIM_TIME))
        self.stop, self.free = StopRequest(), FreeTime()
        for line in check_overrides(self):
            self.get_logger().warning(line)
        topic = self.resolve_topic_name(DIAGNOSTICS_TOPIC)
        qos, overriding = overridden(self, "publisher", topic, QoSProfile(depth=10))
        self._diagnostics: Publisher = self.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, qos,
                                                             qos_overriding_options=overriding)
        self._told_unused: set[str] = set()
        if unused_overrides(self):
            self.create_steady_timer(_UNUSED_S, self._tell_unused)

    def on_compilation(self, progress: Compilation) -> None:
        """Called repeatedly while kernels are compiled."""

    def prepare(self) -> None:
        """Called once before `work`."""

    def on_failure(self, error: BaseException) -> None:
        """An error has escaped a callback; raised again, it ends the node."""
        raise error

    def work(self, spinner: Spinner) -> None:
        """The main loop; returns when `spinner.stopping`, or when there is nothing left to do."""
        while not spinner.stopping:
            spinner.once()

    def create_steady_timer(self, period_s: float, callback: Callable[[], None]) -> None:
        """A timer on the monotonic clock, which runs also while simulated time stands still."""
        self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tell_unused(self) -> None:
        """What was meant for a publisher or subscription that is not there; some come later than others."""
        for name, line in unused_overrides(self).items():
            if name not in self._told_unused:
                self._told_unused.add(name)
                self.get_logger().warning(line)

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
    warnings: list[str | None] = [use_profile(), _init()]
    compilation: BackgroundCompilation | None = None
    try:
        node = make()
        node.stop = stop
        warnings += files_for_others(sys.argv, node.get_fully_qualified_name())
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
    log, started_s, logged = node.get_logger(), time.monotonic(), False
    while not (compilation.done or spinner.stopping):
        node.on_compilation(compilation.progress)
        if compilation.progress.compiled and not logged:
            logged = True
            log.info("compiling kernels, once after an installation; no images are taken until that is done")
        spinner.once()
    if compilation.done:
        _log_compilation(log, compilation.result, time.monotonic() - started_s)


def _log_compilation(log: RcutilsLogger, result: Compilation, seconds: float) -> None:
    if result.compiled:
        log.info(f"compiled {result.compiled} of {result.total} kernels in {seconds:.1f} s")
    if result.trouble:
        log.warning(not_kept(result.trouble))


def _init() -> str:
    """Initialises rclpy; returns a warning, "" for none."""
    set_logger_level("rcl", LoggingSeverity.FATAL)  # rcl would print its own line beside ours
    warning = log_folder.problem(os.environ)
    words = [*sys.argv, *(log_folder.NO_LOG_FILE if warning else ())]
    try:
        with ExitStack() as files:  # which rcl has read once it is initialised
            told = with_lists_as_text(words, lambda: Path(files.enter_context(TemporaryDirectory(prefix="stab_ros_"))))
            rclpy.init(args=told, signal_handler_options=SignalHandlerOptions.NO)
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
