"""The executable `pipeline_node`. The nodes are in `pipeline_node.py`, imported once signals are handled."""

from __future__ import annotations

import sys

from stab_ros.nodes.stopping import StopRequest, node_main


def main() -> int:
    """Runs until SIGINT or SIGTERM; exit code 2 and one line for bad parameters."""
    return node_main("pipeline_node", _run)


def _run(stop: StopRequest) -> int:
    with stop.while_importing():
        from stab_ros.nodes.pipeline_node import run

    return run(stop)


if __name__ == "__main__":
    sys.exit(main())
