"""How the process of a node starts, spins and ends."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rclpy
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.signals import SignalHandlerOptions

from stab_ros.core.errors import InputError
from stab_ros.core.memory import keep_freed_memory
from stab_ros.io.installed_types import python_folders
from stab_ros.nodes import log_folder
from stab_ros.nodes.background_compilation import BackgroundCompilation
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.nested_lists import with_lists_as_text
from stab_ros.nodes.parameter_files import files_for_others, parameters_for_others
from stab_ros.nodes.params import DeclaringNode
from stab_ros.nodes.remappings import rules_for_others, unused_rules
from stab_ros.nodes.spinner import Spinner
from stab_ros.nodes.stopping import StopRequest, end_at_once
from stab_ros.nodes.transport import use_profile


class Started:
    """A process that has initialised rclpy. compilation: of its kernels; None: it needs none, or has not begun."""

    def __init__(self, warnings: Sequence[str | None]) -> None:
        """warnings: of the start, for the log of a node to come."""
        self._warnings = warnings
        self.compilation: BackgroundCompilation | None = None
        self._unused_is_told = False

    def prepare(self, nodes: Sequence[DeclaringNode], log: RcutilsLogger,
                computes: bool) -> BackgroundCompilation | None:
        """Logs what the start warned of, and compiles the kernels if its nodes need them."""
        names = [node.get_fully_qualified_name() for node in nodes]
        words = sys.argv
        for warning in filter(None, [*self._warnings, *files_for_others(words, *names),
                                     *parameters_for_others(words, *names), *rules_for_others(words, nodes)]):
            log.warning(warning)
        managed = [node for node in nodes if isinstance(node, StabNode)]
        managed[0].on_settled = lambda: self._tell_unused(nodes, managed, log)
        self.compilation = BackgroundCompilation() if computes else None
        return self.compilation

    def _tell_unused(self, nodes: Sequence[DeclaringNode], managed: Sequence[StabNode], log: RcutilsLogger) -> None:
        """Once: which rules of the command line none of the nodes has used, when all have had the time to."""
        if self._unused_is_told or not all(node.is_settled for node in managed):
            return
        self._unused_is_told = True
        for line in unused_rules(sys.argv, nodes):
            log.warning(line)


@contextmanager
def started(stop: StopRequest) -> Iterator[Started]:
    """A process of nodes, from its start to its end.

    Raises:
        InputError: bad ROS arguments.
    """
    stop.defer()  # an exception in the middle of rclpy or of a destructor would be lost or leave a trace
    keep_freed_memory()
    process = Started([use_profile(), init()])
    try:
        yield process
    finally:
        rclpy.try_shutdown()
    if process.compilation is not None and not process.compilation.done:
        end_at_once()


def run(make: Callable[[], StabNode], stop: StopRequest) -> int:
    """Runs a node from start to end; exit code 0.

    Raises:
        InputError: bad ROS arguments or parameters. WorkError: the node's work broke off.
    """
    with started(stop) as process:
        node = make()
        node.stop, node.waits = stop, True
        spin(node, process.prepare([node], node.get_logger(), node.COMPUTES))
    return 0


def spin(node: StabNode, compilation: BackgroundCompilation | None) -> None:
    """Runs a node on this thread until its `stop`, and destroys it. compilation: that it waits for; None: for none.

    Raises:
        StabRosError: it cannot take images, or its work broke off.
    """
    spinner = Spinner(node, node.at_once, node.stop, node.free, node.on_escaped)
    try:
        if compilation is not None:
            _compile(node, spinner, compilation)
        if not spinner.stopping:
            if node.autostart:
                node.prepare()
            node.work(spinner)
        node.end()
    finally:
        spinner.close()
        node.destroy_node()


def _compile(node: StabNode, spinner: Spinner, compilation: BackgroundCompilation) -> None:
    """Spins the node until its kernels are compiled; logs it unless all were found in the cache."""
    log, logged = node.get_logger(), False
    while not (compilation.done or spinner.stopping):
        if node.is_configured:
            node.on_compilation(compilation.progress)
        if compilation.progress.compiled and not logged:
            logged = True
            log.info("compiling kernels, once after an installation; no images are taken until that is done")
        spinner.once()
    if compilation.done:
        compilation.tell(log)


def init() -> str:
    """Initialises rclpy; returns a warning, "" for none.

    Raises:
        InputError: bad ROS arguments.
    """
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
