"""The executable `discharge_node`. The node is in `discharge_node.py`, imported once signals are handled."""

from __future__ import annotations

import sys

from stab_ros.nodes.stopping import StopRequest, node_main


def main() -> int:
    """Runs until SIGINT or SIGTERM; exit code 2 and one line for bad parameters."""
    return node_main("discharge_node", _run)


def _run(stop: StopRequest) -> int:
    with stop.while_importing():
        from stab_ros.nodes.discharge_node import DischargeNode
        from stab_ros.nodes.runtime import run

    return run(DischargeNode, stop)


if __name__ == "__main__":
    sys.exit(main())
