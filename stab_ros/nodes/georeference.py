"""The executable `georeference_node`. The node is in `georeference_node.py`, imported once signals are handled."""

from __future__ import annotations

import sys

from stab_ros.nodes.stopping import StopRequest, node_main


def main() -> int:
    """Runs until SIGINT or SIGTERM; exit code 2 and one line for bad parameters."""
    return node_main("georeference_node", _run)


def _run(stop: StopRequest) -> int:
    with stop.while_importing():
        from stab_ros.nodes.georeference_node import GeoreferenceNode
        from stab_ros.nodes.runtime import run

    return run(GeoreferenceNode, stop)


if __name__ == "__main__":
    sys.exit(main())
