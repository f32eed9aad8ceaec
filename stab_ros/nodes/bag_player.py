"""The executable `bag_player_node` and `stab-ros play`; the node itself is in `bag_player_node.py`."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from stab_ros.nodes.stopping import StopRequest, node_main, until_stopped


def main() -> int:
    """Plays the bag of the parameter `bag`; exit code 0 at its end and on SIGINT or SIGTERM, 2 for bad parameters."""
    return node_main("bag_player_node", lambda stop: _run(stop, {}))


def play(given: Mapping[str, object]) -> int:
    """As the executable, with the ROS parameters `given`.

    Raises:
        InputError: a parameter or the bag cannot be used.
    """
    return until_stopped(lambda stop: _run(stop, given))


def _run(stop: StopRequest, given: Mapping[str, object]) -> int:
    with stop.while_importing():
        from stab_ros.nodes.bag_player_node import BagPlayerNode
        from stab_ros.nodes.runtime import run

    return run(lambda: BagPlayerNode(given), stop)


if __name__ == "__main__":
    sys.exit(main())
