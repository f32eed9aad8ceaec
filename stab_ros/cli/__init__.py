"""The command `stab-ros`: parses, runs one command, and turns errors into one line and an exit code.

Exit codes: 0 done, 1 work broke off, 2 bad input or usage, 130 interrupted. Each command is a module of this package
that imports what it needs when it runs, so that usage errors and --help are quick and only `play` and `record` need
ROS.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Sequence

from stab_ros.cli import (
    camera,
    compare,
    convert,
    discharge,
    evaluate,
    georeference,
    info,
    play,
    record,
    recover,
    stabilize,
    telemetry,
    velocity,
    warm_up,
)
from stab_ros.cli.console import BAD_INPUT, BROKEN_OFF, INTERRUPTED, say, tell
from stab_ros.cli.options import Parser, with_negative_pairs
from stab_ros.core.errors import InputError, StabRosError
from stab_ros.core.memory import keep_freed_memory
from stab_ros.core.version import __version__

_COMMANDS = (  # in the order of --help
    stabilize, evaluate, compare, camera, telemetry, georeference, velocity, discharge, convert, play, record, recover,
    info, warm_up)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code; handles every error that is not a bug."""
    options = _parser().parse_args(with_negative_pairs(sys.argv[1:] if arguments is None else arguments))
    keep_freed_memory()
    run: Callable[[argparse.Namespace], int] = options.run
    try:
        code = run(options)
        tell()
        return code
    except StabRosError as error:
        say(str(error))
        return BAD_INPUT if isinstance(error, InputError) else BROKEN_OFF
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process is about to end
        say("interrupted; an unfinished output has .partial in its name")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output has closed it, as in `stab-ros info BAG | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_OFF


def _parser() -> Parser:
    parser = Parser(prog="stab-ros", description="Holds a river still: registers drone video to one reference frame.")
    parser.add_argument("--version", action="version", version=f"stab-ros {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for module in _COMMANDS:
        module.add(commands)
    return parser
