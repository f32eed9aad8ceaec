"""Real nodes with a part that fails at some frames, as one from outside may: `failing_nodes.py NAME ...`.

The first pixel of a frame says what is wrong with it.
"""

from __future__ import annotations

import sys
from typing import Any

from stab_ros.core.types import Correspondences, FloatArray, Gray, Homography
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.methods import METHODS
from stab_ros.methods.direct import Direct
from stab_ros.nodes.evaluator_node import EvaluatorNode
from stab_ros.nodes.runtime import run
from stab_ros.nodes.stopping import StopRequest, node_main
from stab_ros.nodes.tracker_node import TrackerNode

FAILS = 251


class Failing(Direct):
    """A method that divides by zero."""

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        _ = 1 / (FAILS - int(current[0, 0]))
        return super().match(current, guess, trust)


class FailingEvaluator(Evaluator):
    """An evaluator that looks for what is not there."""

    def step(self, arrival: Arrival, check: bool = True) -> FrameMetrics:
        if arrival.frame is not None and arrival.frame.image[0, 0] == FAILS:
            raise IndexError("list index out of range")
        return super().step(arrival, check)


class EvaluatorThatFails(EvaluatorNode):
    """With that evaluator."""

    def configure(self) -> None:
        super().configure()
        self.evaluator = FailingEvaluator(self.evaluator.config)


def main(name: str) -> int:
    """Runs the node of that name."""
    METHODS["direct"] = Failing
    nodes: dict[str, Any] = {"tracker_node": TrackerNode, "evaluator_node": EvaluatorThatFails}

    def body(stop: StopRequest) -> int:
        return run(nodes[name], stop)

    return node_main(name, body)


if __name__ == "__main__":
    sys.exit(main(sys.argv.pop(1)))
