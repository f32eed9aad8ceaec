"""How a node's process starts, spins and ends; what all our nodes have in common."""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.kernels import Compilation
from stab_ros.core.memory import keep_freed_memory
from stab_ros.io.compiling import not_kept
from stab_ros.io.messages import SECOND_NS, WARN, diagnostics_cdr
from stab_ros.nodes.compiling import Compiling
from stab_ros.nodes.free_time import FreeTime
from stab_ros.nodes.stopping import StopRequest, end_at_once
from stab_ros.nodes.transport import use_profile

_STEP_S = 0.1  # how long a wait may last before the wish to stop is looked at
_NO_CLOCK = "use_sim_time is set, but nobody publishes /clock; what tells the time tells zero until somebody does"
_SETTLED_NS, _LONG_NS = 3 * SECOND_NS // 10, SECOND_NS  # of free time


class Spinner:
    """Runs callbacks a little at a time, so that a node's `work` stays a plain loop, and tells its free time."""

    def __init__(self, executor: SingleThreadedExecutor, stop: StopRequest, free: FreeTime) -> None:
        self._executor = executor
        self._stop = stop
        self._free = free

    @property
    def stopping(self) -> bool:
        return self._stop.requested

    def once(self, timeout_s: float = _STEP_S) -> None:
        """Runs one callback, waiting for it at most so long."""
        most_ns, before_ns = round(min(timeout_s, _STEP_S) * SECOND_NS), time.monotonic_ns()
        try:
            callback, _, _ = self._executor.wait_for_ready_callbacks(most_ns / SECOND_NS)
        except (TimeoutException, ShutdownException):
            callback = None
        self._free.waited(time.monotonic_ns() - before_ns, most_ns)
        if callback is not None:
            callback()
            failure = callback.exception()
            if failure is not None:
                raise failure

    def drain(self, progress: Callable[[], int]) -> None:
        """Runs callbacks until the queues are empty: free for a moment without `progress`, or for long altogether."""
        before, start_ns, moved_ns = progress(), self._free.ns, self._free.ns
        while self._free.ns - moved_ns < _SETTLED_NS and self._free.ns - start_ns < _LONG_NS:
            self.once()
            if progress() != before:
                before, moved_ns = progress(), self._free.ns


class StabNode(Node):
    """A node with diagnostics, steady timers, and parameters that may be given to the constructor.

    stop: the wish to end, for what must not wait any longer then. free: its time without anything to do.
    """

    COMPUTES: ClassVar[bool] = False  # with kernels, which are compiled before anything is prepared

    def __init__(self, name: str, given: Mapping[str, Any] | None = None) -> None:
        overrides = [Parameter(key, value=value) for key, value in (given or {}).items()]
        try:  # the overrides are declared as they come, so that `params.declare` can judge them
            super().__init__(name, automatically_declare_parameters_from_overrides=True, parameter_overrides=overrides)
        except ValueError as error:
            raise ConfigError(f"a parameter was given an empty value, it must be left out instead ({error})") from error
        except RuntimeError as error:  # rclpy's RCLError, as where security is asked for and cannot be had
            raise InputError(f"the node cannot be made: {str(error).split(', at ')[0]}") from error
        self.stop, self.free = StopRequest(), FreeTime()
        self._diagnostics: Publisher = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def on_compiling(self, so_far: Compilation) -> None:
        """Told again and again while kernels are compiled."""

    def prepare(self) -> None:
        """What is to be done before the node says that it is ready."""

    def work(self, spinner: Spinner) -> None:
        """The node's life; returns when `spinner.stopping`, or when there is nothing left to do."""
        while not spinner.stopping:
            spinner.once()

    def every(self, period_s: float, callback: Callable[[], None]) -> None:
        """Calls back by the machine's clock, also while a simulated clock stands still."""
        self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def report(self, level: int, message: str, values: Mapping[str, str]) -> None:
        """One status on /diagnostics, named as the node and with its namespace as hardware."""
        now_ns = self.get_clock().now().nanoseconds
        if now_ns == 0:  # only a simulated clock can stand there
            level, message = max(level, WARN), f"{message}; {_NO_CLOCK}"
            self.get_logger().warning(_NO_CLOCK, once=True)
        name = self.get_fully_qualified_name().lstrip("/")
        self._diagnostics.publish(diagnostics_cdr(now_ns, name, self.get_namespace(), level, message, values))

    def flush_reports(self) -> None:
        """Before the end: lets the last report arrive."""
        self._diagnostics.wait_for_all_acked(Duration(seconds=1))


def run(make: Callable[[], StabNode], stop: StopRequest) -> int:
    """A node from start to end, exit code 0.

    Raises:
        InputError: bad ROS arguments or parameters. WorkError: the node's work broke off.
    """
    stop.defer()  # an exception in the middle of rclpy or of a destructor would be lost or leave a trace
    keep_freed_memory()
    warnings = [use_profile(), _init()]
    compiling: Compiling | None = None
    try:
        node = make()
        node.stop = stop
        for warning in filter(None, warnings):
            node.get_logger().warning(warning)
        compiling = Compiling() if node.COMPUTES else None
        _spin(node, stop, compiling)
    finally:
        rclpy.try_shutdown()
    if compiling is not None and not compiling.done:
        end_at_once()
    return 0


def _spin(node: StabNode, stop: StopRequest, compiling: Compiling | None) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        spinner = Spinner(executor, stop, node.free)
        if compiling is not None:
            _compile(node, spinner, compiling)
        if not spinner.stopping:
            node.prepare()
            node.work(spinner)
    finally:
        executor.shutdown()
        node.destroy_node()


def _compile(node: StabNode, spinner: Spinner, compiling: Compiling) -> None:
    """Lets the node live until its kernels are compiled; says so if that takes more than finding them."""
    log, started_s, told = node.get_logger(), time.monotonic(), False
    while not (compiling.done or spinner.stopping):
        node.on_compiling(compiling.so_far)
        if compiling.so_far.compiled and not told:
            told = True
            log.info("compiling kernels, once after an installation; no images are taken until that is done")
        spinner.once()
    if compiling.done:
        _tell_compiled(log, compiling.result, time.monotonic() - started_s)


def _tell_compiled(log: RcutilsLogger, result: Compilation, seconds: float) -> None:
    if result.compiled:
        log.info(f"compiled {result.compiled} of {result.total} kernels in {seconds:.1f} s")
    if result.trouble:
        log.warning(not_kept(result.trouble))


def _init() -> str | None:
    """Joins ROS; a warning, or None."""
    set_logger_level("rcl", LoggingSeverity.FATAL)  # rcl would print its own line beside ours
    folder = _log_folder()
    quiet = [] if folder is not None and _can_be_made(folder) else ["--ros-args", "--disable-external-lib-logs"]
    try:
        rclpy.init(args=[*sys.argv, *quiet], signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rclpy's RCLError is not public
        raise InputError(f"the ROS arguments cannot be used: {str(error).split(', at ')[0]}") from error
    set_logger_level("rcl", LoggingSeverity.UNSET)
    where = "there is no HOME" if folder is None else f"{folder} cannot be made"
    return f"no log file: {where}; name a folder in ROS_LOG_DIR" if quiet else None


def _log_folder() -> Path | None:
    """Where rcl will log to, None if nothing says so; without one that can be made, it would not even start."""
    if "ROS_LOG_DIR" in os.environ:
        return Path(os.environ["ROS_LOG_DIR"])
    if "ROS_HOME" in os.environ:
        return Path(os.environ["ROS_HOME"], "log")
    return Path(os.environ["HOME"], ".ros", "log") if "HOME" in os.environ else None


def _can_be_made(folder: Path) -> bool:
    try:
        folder.expanduser().mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # which `expanduser` raises where there is no home
        return False
    return os.access(folder.expanduser(), os.W_OK)


def message_class(msgtype: str) -> Any:
    """The class of a message type such as `sensor_msgs/msg/Image`.

    Raises:
        InputError: it is not installed.
    """
    named = re.fullmatch(r"(\w+)/msg/(\w+)", msgtype)
    if named is None:
        raise InputError(f"{msgtype!r} is no message type, it must be named as package/msg/Name")
    if not _holds_messages(named[1]):  # a bag may name any module, and importing it runs it
        raise InputError(f"message type {msgtype} is not installed")
    try:
        return getattr(importlib.import_module(f"{named[1]}.msg"), named[2])
    except (ImportError, AttributeError) as error:
        raise InputError(f"message type {msgtype} is not installed") from error


def _holds_messages(package: str) -> bool:
    """Whether an installed package looks like one of messages; it is not imported."""
    spec = importlib.util.find_spec(package)
    places = spec.submodule_search_locations if spec else None
    return any((Path(place) / "msg" / "__init__.py").is_file() for place in places or ())
