"""The executable `bag_recorder_node` and `stab-ros record`; the node itself is in `bag_recorder_node.py`."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from stab_ros.nodes.stopping import StopRequest, node_main, until_stopped


def main() -> int:
    """Records until SIGINT or SIGTERM; exit code 2 for bad parameters, 1 if the disk was full."""
    return node_main("bag_recorder_node", lambda stop: _run(stop, {}))


def record(given: Mapping[str, object]) -> int:
    """As the executable, with the ROS parameters `given`.

    Raises:
        InputError: a parameter cannot be used, or the output exists. WorkError: the disk was full.
    """
    return until_stopped(lambda stop: _run(stop, given))


def _run(stop: StopRequest, given: Mapping[str, object]) -> int:
    with stop.while_importing():
        from stab_ros.nodes.bag_recorder_node import BagRecorderNode
        from stab_ros.nodes.runtime import run

    return run(lambda: BagRecorderNode(given), stop)


if __name__ == "__main__":
    sys.exit(main())
